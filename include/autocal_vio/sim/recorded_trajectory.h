// A recorded motion as a smooth function of time.
//
//   RecordedTrajectory trajectory(readTrajectory("mav0/state_groundtruth_estimate0/data.csv"));
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "autocal_vio/imu/imu_types.h"
#include "autocal_vio/sim/trajectory.h"

namespace autocal_vio {

struct TimedPose {
  TimeNs stamp = 0;
  Transform T_WB;
};

/// Reads a trajectory file: EuRoC ground truth (`stamp_ns,px,py,pz,qw,qx,qy,qz,...`, comma separated) or TUM
/// (`stamp_s px py pz qx qy qz qw`, blanks). Lines beginning with # and blank lines are skipped.
/// Throws std::invalid_argument naming file, line and problem.
std::vector<TimedPose> readTrajectory(const std::string& path);

/// Reads an IMU file in EuRoC's format: `stamp_ns,wx,wy,wz,ax,ay,az`. Throws as readTrajectory does.
std::vector<ImuSample> readImu(const std::string& path);

/// Uniform quintic B-splines (C^4) fitted to recorded poses by least squares. Velocity, acceleration and
/// angular velocity are the exact derivatives of the spline, so that IMU samples made from it are consistent
/// with its poses. The orientation is a spline in the four quaternion components, normalised.
class RecordedTrajectory : public Trajectory {
 public:
  /// `knot_spacing` [s]: motion much faster than it is smoothed away; raised to the interval of the poses, at which the
  /// spline goes through every one of them. Throws std::invalid_argument for fewer than 8 poses or stamps that do not rise.
  explicit RecordedTrajectory(const std::vector<TimedPose>& poses, double knot_spacing = 0.1);

  RigMotion at(TimeNs stamp) const override;
  TimeNs begin() const override { return begin_; }
  TimeNs end() const override { return end_; }

 private:
  using Controls = Eigen::Matrix<double, Eigen::Dynamic, 7>;  ///< rows: position, quaternion x y z w

  void fit(const std::vector<TimedPose>& poses);

  TimeNs begin_ = 0;
  TimeNs end_ = 0;
  double spacing_ = 0.1;  ///< [s]
  Controls controls_;
};

}  // namespace autocal_vio
