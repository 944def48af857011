#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/sim/trajectory.h"

namespace autocal_vio {

enum class MotionKind {
  kFree,              ///< hand or drone: all six axes
  kStandstill,        ///< nothing moves
  kPureRotation,      ///< all rotation axes about the IMU's origin, no translation
  kPanTilt,           ///< as pure rotation, about two axes only
  kPivot,             ///< all rotation axes about a fixed point that is 0.4 m from the IMU
  kOneAxisRotation,   ///< free translation, rotation about one random axis only
  kConstantVelocity,  ///< no rotation, constant velocity once started
  kPlanar,            ///< driving a figure of eight: heading along the velocity, level
  kStraightLine       ///< no rotation, to and fro along one line
};

/// Kind of a name: "free", "standstill", "pure_rotation", "pan_tilt", "pivot", "one_axis_rotation", "constant_velocity",
/// "planar", "straight_line"; nothing for another name.
std::optional<MotionKind> motionKindFromName(const std::string& name);

struct SineTrajectoryOptions {
  std::uint64_t seed = 1;
  MotionKind kind = MotionKind::kFree;
  TimeNs begin = 1000 * kNsPerSecond;  ///< stamp of the first instant, IMU clock
  double duration = 60.0;              ///< [s]
  double still_time = 1.0;             ///< at rest at the beginning [s]
  double ramp_time = 3.0;              ///< from rest to full speed after that [s]
  bool start_moving = false;           ///< at full speed from the first instant on
  double speed_factor = 1.0;           ///< stretches time: 2 is twice as fast (4 times the acceleration)
  double translation_factor =
      1.0;  ///< of the positions: 0.02 is turning in the hand, which sways by centimetres
  std::optional<Eigen::Quaterniond> start_attitude;  ///< R_WB at begin; absent: any, drawn with the seed
};

/// Seeded sums of sines in position and Euler angles over a warped time that starts smoothly (C^3) from rest.
/// kFree: within about +-1.5 m, 0.5-1.5 m/s, 1-3 m/s^2, 0.3-1 rad/s on each axis.
class SineTrajectory : public Trajectory {
 public:
  /// Throws std::invalid_argument for a duration, time or factor that is not usable.
  explicit SineTrajectory(const SineTrajectoryOptions& options);

  RigMotion at(TimeNs stamp) const override;
  TimeNs begin() const override { return options_.begin; }
  TimeNs end() const override { return options_.begin + fromSeconds(options_.duration); }

 private:
  struct Sine {
    double amplitude, frequency, phase;  ///< frequency in rad/s
  };
  using Sum = std::vector<Sine>;
  struct Warp {
    double u, rate, acceleration;
  };
  struct Derivatives {
    Eigen::Vector3d value, first, second;  ///< with respect to u
  };

  static Derivatives sum(const std::array<Sum, 3>& sines, double u);

  void drawPosition();
  void drawRotation();
  Warp warpedTime(double t) const;
  Derivatives anglesAt(double u, const Derivatives& position) const;  ///< roll, pitch, yaw
  Derivatives aboutPivot(const Derivatives& angles) const;            ///< position

  SineTrajectoryOptions options_;
  std::array<Sum, 3> position_;
  std::array<Sum, 3> angles_;                                  ///< roll, pitch, yaw
  Eigen::Vector3d drift_ = Eigen::Vector3d::Zero();            ///< constant velocity [m/s]
  Eigen::Vector3d lever_ = Eigen::Vector3d::Zero();            ///< from the pivot, in the body that turns [m]
  Eigen::Quaterniond frame_ = Eigen::Quaterniond::Identity();  ///< axes of the Euler angles, in W
  Eigen::Quaterniond mounting_ = Eigen::Quaterniond::Identity();  ///< of B in the body that turns
};

}  // namespace autocal_vio
