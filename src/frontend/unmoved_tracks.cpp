#include "autocal_vio/frontend/unmoved_tracks.h"

#include <algorithm>

namespace autocal_vio {
namespace {

constexpr double kUnmoved = 0.02;  // [px] in the median; what a tracker makes of the same image twice
constexpr std::size_t kFewestPoints = 8;

}  // namespace

bool UnmovedTracks::look(const std::vector<Feature>& features) {
  std::vector<double> displacements;
  auto it = before_.begin();
  for (const Feature& feature : features) {
    while (it != before_.end() && it->track_id < feature.track_id) ++it;
    if (it == before_.end()) break;
    if (it->track_id == feature.track_id) displacements.push_back((feature.pixel - it->pixel).norm());
  }
  before_ = features;
  if (displacements.size() < kFewestPoints) return false;
  const auto middle = displacements.begin() + static_cast<std::ptrdiff_t>(displacements.size() / 2);
  std::nth_element(displacements.begin(), middle, displacements.end());
  return *middle < kUnmoved;
}

}  // namespace autocal_vio
