#include "autocal_vio/frontend/unmoved_tracks.h"

namespace autocal_vio {
namespace {

constexpr int kFewestPoints = 8;

}  // namespace

bool UnmovedTracks::look(const std::vector<Feature>& features) {
  int common = 0;
  bool moved = false;
  auto it = before_.begin();
  for (const Feature& feature : features) {
    while (it != before_.end() && it->track_id < feature.track_id) ++it;
    if (it == before_.end()) break;
    if (it->track_id != feature.track_id) continue;
    ++common;
    moved = moved || feature.pixel != it->pixel;
  }
  before_ = features;
  return !moved && common >= kFewestPoints;
}

}  // namespace autocal_vio
