// Landmarks of the estimation problem: which track is which landmark, triangulation, outliers.
//
// A track is cut into landmarks of a few keyframes each, with different lengths so that cuts are spread over time.
// Each measurement belongs to one landmark and enters the prior at most once; and the slow drift of a KLT track
// (correlated errors) cannot pile up in one landmark.
#pragma once

#include <Eigen/Core>
#include <deque>
#include <map>
#include <set>
#include <unordered_map>
#include <vector>

#include "autocal_vio/graph/frame_state.h"

namespace autocal_vio {

struct Observation {
  FrameId frame = 0;
  Feature feature;
};

struct Landmark {
  std::int64_t id = 0;
  std::int64_t track_id = 0;
  Transform T_WA;  ///< anchor: camera pose at initialisation, constant
  std::array<double, 3> parameters{
      {0, 0, 0.2}};                       ///< alpha, beta (x/z, y/z in the anchor), inverse depth rho [1/m]
  std::vector<Observation> observations;  ///< in order of time
  int max_observations = 8;               ///< closed (its track goes on as a new landmark) beyond this
  bool initialized = false;
  bool solved = false;  ///< has been part of a solution of the whole problem

  /// World position [m]; only meaningful where rho is well above zero.
  Eigen::Vector3d position() const {
    const Eigen::Vector3d direction(parameters[0], parameters[1], 1.0);
    return T_WA * Eigen::Vector3d(direction / parameters[2]);
  }
};

class LandmarkMap {
 public:
  /// Landmarks get between `shortest` and `longest` observations.
  LandmarkMap(int shortest, int longest) : shortest_(shortest), longest_(longest) {}

  /// Adds the features of a frame as observations, but for those of tracks that wander.
  void addObservations(const FrameState& frame);

  /// The newest of the frames added is seen again from the same place, in a later image whose features it now holds:
  /// tracks that are new begin landmarks in it, and landmarks that nothing but it has seen go with their tracks.
  void renewTracks(const FrameState& frame);

  /// Forgets the frame's observations; landmarks left without any go.
  void removeObservations(FrameId frame);

  /// Closes landmarks that are full, so that their tracks go on as new ones. Call when a frame became a keyframe.
  void closeFullLandmarks();

  /// Initialises landmarks with at least two observations by triangulation from the frames' present poses.
  void initialize(const std::deque<FrameState>& frames, const CalibrationState& calibration);

  /// Takes out the landmarks observed in `frame`.
  std::vector<Landmark> extractObservedIn(FrameId frame);

  /// Drops observations whose reprojection error exceeds `threshold` [px]. Of a landmark that fits badly as a whole (rms,
  /// each error up to the threshold), or whose point is on the lens, nothing stays, unless a third of all do: a point that slides finds some depth where
  /// part of it fits, and that depth is wrong. A track whose newest point does not fit wanders: its landmark is closed and the track counts no more.
  /// Others that are left with fewer than two observations start anew. Returns how many observations were dropped.
  int dropOutliers(const std::deque<FrameState>& frames, const CalibrationState& calibration,
                   double threshold);

  /// Tracks of the newest frame that slid off their point, along an edge or onto something else. Many at once are no
  /// tracks that wander but a pose that is wrong, and none is counted then.
  const std::set<std::int64_t>& wanderingTracks() const { return wandering_; }

  /// True when the track is part of an initialised landmark.
  bool isTrackInitialized(std::int64_t track_id) const;

  std::map<std::int64_t, Landmark>& landmarks() { return landmarks_; }
  const std::map<std::int64_t, Landmark>& landmarks() const { return landmarks_; }

 private:
  void beginLandmark(FrameId frame, const Feature& feature);
  void erase(std::map<std::int64_t, Landmark>::iterator it);
  /// Landmarks that fit badly as a whole (see dropOutliers); none where so many do that the poses must be wrong.
  std::set<std::int64_t> slidingLandmarks(const std::deque<FrameState>& frames,
                                          const CalibrationState& calibration, double threshold) const;

  int shortest_, longest_;
  std::int64_t next_id_ = 0;
  std::map<std::int64_t, Landmark> landmarks_;  ///< by landmark id, so that order is repeatable
  std::unordered_map<std::int64_t, std::int64_t> open_by_track_;  ///< track id -> landmark id
  std::set<std::int64_t> wandering_;
};

/// Pixel error of an observation at the present states, first order in the distortion; infinite when behind.
double reprojectionError(const Landmark& landmark, const Observation& observation, const FrameState& frame,
                         const CalibrationState& calibration);

}  // namespace autocal_vio
