#include "autocal_vio/frontend/unmoved_tracks.h"

#include "autocal_vio/frontend/common_tracks.h"

namespace autocal_vio {
namespace {

constexpr std::size_t kFewestPoints = 8;

}  // namespace

bool UnmovedTracks::look(const std::vector<Feature>& features) {
  bool moved = false;
  const std::size_t common = forEachCommonTrack(
      before_, features,
      [&moved](const Feature& before, const Feature& now) { moved = moved || now.pixel != before.pixel; });
  before_ = features;
  return !moved && common >= kFewestPoints;
}

}  // namespace autocal_vio
