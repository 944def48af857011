#include "autocal_vio/graph/landmark_map.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "autocal_vio/factors/reprojection_factor.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

constexpr double kDefaultInverseDepth = 0.25;  // [1/m]
constexpr double kMinInverseDepth = 0.01;      // [1/m]
constexpr double kMaxInverseDepth = 10.0;      // [1/m]
constexpr double kMinParallaxPx = 1.0;         // below it triangulation says nothing about depth
constexpr double kLandmarkShare = 0.7;  // of an observation's threshold: for the rms of all of a landmark
constexpr double kMostSliding = 0.33;   // share of all landmarks; more, and it is the poses that are wrong
constexpr double kMostWandering = 0.5;  // share of a frame's landmarks; more, and the frame is wrong

const FrameState* findFrame(const std::deque<FrameState>& frames, FrameId id) {
  const auto it = std::lower_bound(frames.begin(), frames.end(), id,
                                   [](const FrameState& frame, FrameId wanted) { return frame.id < wanted; });
  return it != frames.end() && it->id == id ? &*it : nullptr;
}

// Pose of the camera at the image's instant, td included to first order.
Transform cameraPose(const FrameState& frame, const CalibrationState& calibration) {
  const double shift = calibration.td - frame.reference_td;
  const Eigen::Vector3d w = frame.measured_angular_velocity - frame.bias().gyroscope;
  const Transform T_WB(frame.rotation() * expSo3((w * shift).eval()),
                       frame.position() + frame.velocity() * shift);
  return T_WB * calibration.T_BC();
}

// Inverse depth in the anchor by linear least squares over the other observations: each says that
// bearing x R_CW (rho (p_A - p_C) + R_WA d) = 0.
double triangulate(const Landmark& landmark, const Transform& T_WA, const std::deque<FrameState>& frames,
                   const CalibrationState& calibration) {
  const Eigen::Vector2d anchor = landmark.observations.front().feature.normalized;
  const Eigen::Vector3d direction_W = T_WA.rotation * Eigen::Vector3d(anchor.x(), anchor.y(), 1.0);
  double numerator = 0.0, denominator = 0.0, focal_squared = 1.0;
  for (const Observation& observation : landmark.observations) {
    const FrameState* frame = findFrame(frames, observation.frame);
    if (!frame) continue;
    const Transform T_CW = cameraPose(*frame, calibration).inverse();
    const Eigen::Vector3d bearing = observation.feature.normalized.homogeneous();
    const Eigen::Vector3d a = bearing.cross(T_CW * T_WA.translation);
    const Eigen::Vector3d b = bearing.cross(T_CW.rotation * direction_W);
    numerator -= a.dot(b);
    denominator += a.squaredNorm();
    focal_squared = observation.feature.pixel_jacobian.squaredNorm() / 2.0;
  }
  // denominator * f^2 is the squared parallax of a point at one metre.
  if (denominator * focal_squared * kDefaultInverseDepth * kDefaultInverseDepth <
      kMinParallaxPx * kMinParallaxPx)
    return kDefaultInverseDepth;
  return std::clamp(numerator / denominator, kMinInverseDepth, kMaxInverseDepth);
}

}  // namespace

void LandmarkMap::addObservations(const FrameState& frame) {
  std::set<std::int64_t> still_wandering;
  for (const Feature& feature : frame.features) {
    if (wandering_.count(feature.track_id) != 0) {
      still_wandering.insert(feature.track_id);
      continue;
    }
    const auto open = open_by_track_.find(feature.track_id);
    if (open != open_by_track_.end()) {
      landmarks_.at(open->second).observations.push_back({frame.id, feature});
      continue;
    }
    beginLandmark(frame.id, feature);
  }
  wandering_ = std::move(still_wandering);
}

void LandmarkMap::beginLandmark(FrameId frame, const Feature& feature) {
  Landmark landmark;
  landmark.id = next_id_++;
  landmark.track_id = feature.track_id;
  landmark.max_observations = shortest_ + static_cast<int>(landmark.id % (longest_ - shortest_ + 1));
  landmark.observations.push_back({frame, feature});
  open_by_track_[feature.track_id] = landmark.id;
  landmarks_.emplace(landmark.id, std::move(landmark));
}

void LandmarkMap::renewTracks(const FrameState& frame) {
  std::set<std::int64_t> tracks;
  for (const Feature& feature : frame.features) tracks.insert(feature.track_id);
  for (auto it = landmarks_.begin(); it != landmarks_.end();) {
    auto current = it++;
    const Landmark& landmark = current->second;
    if (landmark.observations.size() == 1 && landmark.observations.front().frame == frame.id &&
        tracks.count(landmark.track_id) == 0)
      erase(current);
  }
  for (const Feature& feature : frame.features)
    if (wandering_.count(feature.track_id) == 0 && open_by_track_.count(feature.track_id) == 0)
      beginLandmark(frame.id, feature);
}

void LandmarkMap::erase(std::map<std::int64_t, Landmark>::iterator it) {
  const auto open = open_by_track_.find(it->second.track_id);
  if (open != open_by_track_.end() && open->second == it->first) open_by_track_.erase(open);
  landmarks_.erase(it);
}

void LandmarkMap::removeObservations(FrameId frame) {
  for (auto it = landmarks_.begin(); it != landmarks_.end();) {
    auto current = it++;
    std::vector<Observation>& observations = current->second.observations;
    observations.erase(std::remove_if(observations.begin(), observations.end(),
                                      [frame](const Observation& o) { return o.frame == frame; }),
                       observations.end());
    if (observations.size() < 2) current->second.initialized = false;
    if (observations.empty()) erase(current);
  }
}

void LandmarkMap::closeFullLandmarks() {
  for (auto it = open_by_track_.begin(); it != open_by_track_.end();) {
    const Landmark& landmark = landmarks_.at(it->second);
    if (static_cast<int>(landmark.observations.size()) >= landmark.max_observations) {
      it = open_by_track_.erase(it);
    } else {
      ++it;
    }
  }
}

void LandmarkMap::initialize(const std::deque<FrameState>& frames, const CalibrationState& calibration) {
  for (auto& [id, landmark] : landmarks_) {
    if (landmark.initialized || landmark.observations.size() < 2) continue;
    const FrameState* first = findFrame(frames, landmark.observations.front().frame);
    if (!first) continue;
    landmark.T_WA = cameraPose(*first, calibration);
    const Eigen::Vector2d anchor = landmark.observations.front().feature.normalized;
    landmark.parameters = {
        {anchor.x(), anchor.y(), triangulate(landmark, landmark.T_WA, frames, calibration)}};
    landmark.initialized = true;
  }
}

std::vector<Landmark> LandmarkMap::extractObservedIn(FrameId frame) {
  std::vector<Landmark> extracted;
  for (auto it = landmarks_.begin(); it != landmarks_.end();) {
    auto current = it++;
    const std::vector<Observation>& observations = current->second.observations;
    if (std::none_of(observations.begin(), observations.end(),
                     [&](const Observation& o) { return o.frame == frame; }))
      continue;
    extracted.push_back(current->second);
    erase(current);
  }
  return extracted;
}

std::set<std::int64_t> LandmarkMap::slidingLandmarks(const std::deque<FrameState>& frames,
                                                     const CalibrationState& calibration,
                                                     double threshold) const {
  std::set<std::int64_t> sliding;
  std::size_t looked_at = 0;
  for (const auto& [id, landmark] : landmarks_) {
    if (!landmark.initialized) continue;
    ++looked_at;
    double squares = 0.0;
    for (const Observation& observation : landmark.observations) {
      const FrameState* frame = findFrame(frames, observation.frame);
      const double error = frame ? reprojectionError(landmark, observation, *frame, calibration) : threshold;
      squares += std::pow(std::min(error, threshold), 2);
    }
    const double rms = std::sqrt(squares / static_cast<double>(landmark.observations.size()));
    if (rms > kLandmarkShare * threshold || landmark.parameters[2] > kMaxInverseDepth) sliding.insert(id);
  }
  const bool believable = static_cast<double>(sliding.size()) < kMostSliding * static_cast<double>(looked_at);
  return believable ? sliding : std::set<std::int64_t>();
}

int LandmarkMap::dropOutliers(const std::deque<FrameState>& frames, const CalibrationState& calibration,
                              double threshold) {
  int dropped = 0;
  std::size_t seen = 0;
  std::vector<std::int64_t> wandering;
  const std::set<std::int64_t> sliding = slidingLandmarks(frames, calibration, threshold);
  for (auto it = landmarks_.begin(); it != landmarks_.end();) {
    auto current = it++;
    Landmark& landmark = current->second;
    if (!landmark.initialized) continue;
    const FrameId last = landmark.observations.back().frame;
    seen += last == frames.back().id;
    std::vector<Observation> kept;
    for (const Observation& observation : landmark.observations) {
      const FrameState* frame = findFrame(frames, observation.frame);
      if (frame && reprojectionError(landmark, observation, *frame, calibration) < threshold)
        kept.push_back(observation);
    }
    if (sliding.count(current->first) != 0) kept.clear();
    if (kept.size() == landmark.observations.size()) continue;
    dropped += static_cast<int>(landmark.observations.size() - kept.size());
    landmark.observations = std::move(kept);
    const bool slid = landmark.observations.empty() || landmark.observations.back().frame != last;
    if (last == frames.back().id && slid) wandering.push_back(landmark.track_id);
    if (landmark.observations.size() < 2) erase(current);
  }
  if (static_cast<double>(wandering.size()) > kMostWandering * static_cast<double>(seen)) return dropped;
  for (const std::int64_t track : wandering) {
    open_by_track_.erase(track);
    wandering_.insert(track);
  }
  return dropped;
}

bool LandmarkMap::isTrackInitialized(std::int64_t track_id) const {
  const auto open = open_by_track_.find(track_id);
  return open != open_by_track_.end() && landmarks_.at(open->second).initialized;
}

double reprojectionError(const Landmark& landmark, const Observation& observation, const FrameState& frame,
                         const CalibrationState& calibration) {
  const Transform T_CW = cameraPose(frame, calibration).inverse();
  const Eigen::Vector3d direction(landmark.parameters[0], landmark.parameters[1], 1.0);
  const double rho = landmark.parameters[2];
  const Eigen::Vector3d h =
      rho * (T_CW * landmark.T_WA.translation) + T_CW.rotation * (landmark.T_WA.rotation * direction);
  if (h.z() <= 0.02) return std::numeric_limits<double>::infinity();
  const Eigen::Vector2d error = observation.feature.normalized - h.head<2>() / h.z();
  return (observation.feature.pixel_jacobian * error).norm();
}

}  // namespace autocal_vio
