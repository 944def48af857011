// The tracks that two images have in common.
#pragma once

#include <cstddef>

namespace autocal_vio {

/// Calls visit(point of a, point of b) for every track of both, in ascending order of track_id, in which both must be:
/// any range of points that have one. Returns how many these are.
template <typename PointsA, typename PointsB, typename Visit>
std::size_t forEachCommonTrack(const PointsA& a, const PointsB& b, Visit visit) {
  std::size_t count = 0;
  auto it = a.begin();
  for (const auto& point : b) {
    while (it != a.end() && it->track_id < point.track_id) ++it;
    if (it == a.end()) break;
    if (it->track_id != point.track_id) continue;
    visit(*it, point);
    ++count;
  }
  return count;
}

}  // namespace autocal_vio
