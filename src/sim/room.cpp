#include "autocal_vio/sim/room.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "autocal_vio/sim/random_source.h"

namespace autocal_vio {
namespace {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

constexpr double kNearestWall = 1.7;         // [m]
constexpr double kFarthestWall = 3.0;        // [m]
constexpr double kClearance = 0.7;           // between positions of B and obstacles [m]
constexpr double kVolumePerObstacle = 15.0;  // [m^3]
constexpr int kLeastObstacles = 9;
constexpr int kAttempts = 60;  // to place one obstacle

std::vector<Vector3d> samplePositions(const Trajectory& trajectory) {
  constexpr TimeNs kStep = kNsPerSecond / 20;
  std::vector<Vector3d> positions;
  for (TimeNs t = trajectory.begin(); t < trajectory.end(); t += kStep)
    positions.push_back(trajectory.at(t).T_WB.translation);
  positions.push_back(trajectory.at(trajectory.end()).T_WB.translation);
  return positions;
}

// A pillar, a cabinet on the floor, a beam under the ceiling or a box on a wall.
AlignedBox3d drawObstacle(const AlignedBox3d& walls, RandomSource* random) {
  Vector3d size, center;
  for (int i = 0; i < 3; ++i) size(i) = random->uniform(0.25, 1.0);
  for (int i = 0; i < 3; ++i) center(i) = random->uniform(walls.min()(i), walls.max()(i));
  AlignedBox3d box(center - 0.5 * size, center + 0.5 * size);
  const double kind = random->uniform(0.0, 1.0);
  if (kind < 0.35) {
    box.min().z() = walls.min().z();
    box.max().z() = walls.max().z();
  } else if (kind < 0.65) {
    box.min().z() = walls.min().z();
    box.max().z() = walls.min().z() + 1.6 * size.z();
  } else if (kind < 0.8) {
    box.max().z() = walls.max().z();
    box.min().z() = walls.max().z() - size.z();
  } else {
    const int axis = random->chance(0.5) ? 0 : 1;
    box.min()(axis) = walls.min()(axis);
    box.max()(axis) = walls.min()(axis) + 0.7 * size(axis);
  }
  return box.intersection(walls);
}

}  // namespace

Room Room::around(const Trajectory& trajectory, std::uint64_t seed) {
  RandomSource random(seed, 40);
  const std::vector<Vector3d> positions = samplePositions(trajectory);
  Room room;
  for (const Vector3d& p : positions) room.walls.extend(p);
  for (int i = 0; i < 3; ++i) {
    room.walls.min()(i) -= random.uniform(kNearestWall, kFarthestWall);
    room.walls.max()(i) += random.uniform(kNearestWall, kFarthestWall);
  }
  const int wanted =
      std::clamp(static_cast<int>(room.walls.volume() / kVolumePerObstacle), kLeastObstacles, kMaxObstacles);
  for (int attempt = 0; attempt < wanted * kAttempts; ++attempt) {
    if (static_cast<int>(room.obstacles.size()) == wanted) break;
    const AlignedBox3d box = drawObstacle(room.walls, &random);
    const bool in_the_way = std::any_of(positions.begin(), positions.end(), [&box](const Vector3d& p) {
      return box.squaredExteriorDistance(p) < kClearance * kClearance;
    });
    if (!in_the_way) room.obstacles.push_back(box);
  }
  return room;
}

double Room::castRay(const Vector3d& origin, const Vector3d& direction) const {
  const Vector3d inverse = direction.cwiseInverse();
  const Vector3d to_walls =
      (walls.min() - origin).cwiseProduct(inverse).cwiseMax((walls.max() - origin).cwiseProduct(inverse));
  double nearest = to_walls.minCoeff();
  for (const AlignedBox3d& box : obstacles) {
    const Vector3d a = (box.min() - origin).cwiseProduct(inverse);
    const Vector3d b = (box.max() - origin).cwiseProduct(inverse);
    const double entry = a.cwiseMin(b).maxCoeff(), exit = a.cwiseMax(b).minCoeff();
    if (entry > 0.0 && entry <= exit) nearest = std::min(nearest, entry);
  }
  return nearest;
}

}  // namespace autocal_vio
