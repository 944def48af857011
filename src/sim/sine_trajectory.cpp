#include "autocal_vio/sim/sine_trajectory.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "autocal_vio/sim/random_source.h"

namespace autocal_vio {
namespace {

constexpr double kTwoPi = 6.283185307179586;
constexpr double kConstantVelocityLength = 3.0;  // path of the constant velocity motion [m]
constexpr double kPivotDistance = 0.4;           // from the fixed point that a pivoting rig turns about [m]

// R = Rz(yaw) Ry(pitch) Rx(roll).
Eigen::Quaterniond fromEuler(const Eigen::Vector3d& roll_pitch_yaw) {
  return Eigen::AngleAxisd(roll_pitch_yaw.z(), Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(roll_pitch_yaw.y(), Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(roll_pitch_yaw.x(), Eigen::Vector3d::UnitX());
}

// Angular velocity in the turning frame from the rates of fromEuler's angles.
Eigen::Vector3d angularVelocity(const Eigen::Vector3d& angles, const Eigen::Vector3d& rates) {
  const double sr = std::sin(angles.x()), cr = std::cos(angles.x());
  const double sp = std::sin(angles.y()), cp = std::cos(angles.y());
  return {rates.x() - rates.z() * sp, rates.y() * cr + rates.z() * sr * cp,
          -rates.y() * sr + rates.z() * cr * cp};
}

// Its derivative, the angles being given with their first and second derivatives.
Eigen::Vector3d angularAcceleration(const Eigen::Vector3d& angles, const Eigen::Vector3d& first,
                                    const Eigen::Vector3d& second) {
  const double sr = std::sin(angles.x()), cr = std::cos(angles.x());
  const double sp = std::sin(angles.y()), cp = std::cos(angles.y());
  const Eigen::Vector3d by_angles(
      -first.z() * cp * first.y(),
      -first.y() * sr * first.x() + first.z() * (cr * cp * first.x() - sr * sp * first.y()),
      -first.y() * cr * first.x() - first.z() * (sr * cp * first.x() + cr * sp * first.y()));
  return angularVelocity(angles, second) + by_angles;
}

}  // namespace

std::optional<MotionKind> motionKindFromName(const std::string& name) {
  if (name == "free") return MotionKind::kFree;
  if (name == "standstill") return MotionKind::kStandstill;
  if (name == "pure_rotation") return MotionKind::kPureRotation;
  if (name == "pan_tilt") return MotionKind::kPanTilt;
  if (name == "pivot") return MotionKind::kPivot;
  if (name == "one_axis_rotation") return MotionKind::kOneAxisRotation;
  if (name == "constant_velocity") return MotionKind::kConstantVelocity;
  if (name == "planar") return MotionKind::kPlanar;
  if (name == "straight_line") return MotionKind::kStraightLine;
  return std::nullopt;
}

SineTrajectory::SineTrajectory(const SineTrajectoryOptions& options) : options_(options) {
  if (!(options.duration > 0.0 && options.duration < 1e6))
    throw std::invalid_argument("trajectory: duration must be within (0, 1e6) s");
  if (!(options.still_time >= 0.0) || !(options.ramp_time >= 0.0))
    throw std::invalid_argument("trajectory: still_time and ramp_time must not be negative");
  if (!(options.translation_factor >= 0.0 && options.translation_factor <= 100.0))
    throw std::invalid_argument("trajectory: translation_factor must be within [0, 100]");
  if (!(options.speed_factor > 0.0 && options.speed_factor < 100.0))
    throw std::invalid_argument("trajectory: speed_factor must be within (0, 100)");
  drawPosition();
  drawRotation();
  RandomSource random(options_.seed, 3);
  const Eigen::Quaterniond start =
      options_.start_attitude ? options_.start_attitude->normalized() : random.rotation();
  const Eigen::Vector3d angles = anglesAt(0.0, sum(position_, 0.0)).value;
  mounting_ = (frame_ * fromEuler(angles)).conjugate() * start;
}

void SineTrajectory::drawPosition() {
  RandomSource random(options_.seed, 1);
  const auto draw = [&random](double a0, double a1, double f0, double f1) {
    const double amplitude = random.uniform(a0, a1);
    const double frequency = kTwoPi * random.uniform(f0, f1);
    return Sine{amplitude, frequency, random.uniform(0.0, kTwoPi)};
  };
  std::array<Sum, 3> free;
  for (Sum& axis : free)
    axis = {draw(0.6, 0.9, 0.10, 0.17), draw(0.15, 0.25, 0.25, 0.40), draw(0.04, 0.07, 0.7, 1.0)};
  const Eigen::Vector3d direction = random.unitVector();
  switch (options_.kind) {
    case MotionKind::kStandstill:
    case MotionKind::kPureRotation:
    case MotionKind::kPanTilt:
      break;
    case MotionKind::kPivot:
      lever_ = kPivotDistance * options_.translation_factor * direction;
      break;
    case MotionKind::kConstantVelocity:
      drift_ = direction * kConstantVelocityLength / warpedTime(options_.duration).u;
      break;
    case MotionKind::kPlanar: {
      const double frequency = kTwoPi * random.uniform(0.07, 0.1);
      position_[0] = {{1.4, frequency, 0.0}};
      position_[1] = {{1.0, 2.0 * frequency, 0.0}};
      break;
    }
    case MotionKind::kStraightLine:
      position_ = {free[0], free[0], free[0]};
      for (int i = 0; i < 3; ++i)
        for (Sine& sine : position_[i]) sine.amplitude *= direction(i);
      break;
    case MotionKind::kFree:
    case MotionKind::kOneAxisRotation:
      position_ = free;
      break;
  }
  drift_ *= options_.translation_factor;
  for (Sum& axis : position_)
    for (Sine& sine : axis) sine.amplitude *= options_.translation_factor;
}

void SineTrajectory::drawRotation() {
  RandomSource random(options_.seed, 2);
  const auto draw = [&random](double a0, double a1, double f0, double f1) {
    const double amplitude = random.uniform(a0, a1);
    const double frequency = kTwoPi * random.uniform(f0, f1);
    return Sine{amplitude, frequency, random.uniform(0.0, kTwoPi)};
  };
  std::array<Sum, 3> free;
  for (Sum& axis : free) axis = {draw(0.3, 0.5, 0.1, 0.2), draw(0.1, 0.15, 0.4, 0.6)};
  if (options_.kind == MotionKind::kFree || options_.kind == MotionKind::kPureRotation ||
      options_.kind == MotionKind::kPivot)
    angles_ = free;
  if (options_.kind == MotionKind::kOneAxisRotation || options_.kind == MotionKind::kPanTilt) {
    angles_[2] = free[2];
    if (options_.kind == MotionKind::kPanTilt) angles_[1] = free[1];
    frame_ = random.rotation();
  }
}

SineTrajectory::Warp SineTrajectory::warpedTime(double t) const {
  const double k = options_.speed_factor;
  if (options_.start_moving) return {k * t, k, 0.0};
  const double since = t - options_.still_time, ramp = options_.ramp_time;
  if (since <= 0.0) return {0.0, 0.0, 0.0};
  if (since >= ramp) return {k * (since - 0.5 * ramp), k, 0.0};
  // The rate is the quintic smooth step 6x^5 - 15x^4 + 10x^3.
  const double x = since / ramp, x2 = x * x;
  return {k * ramp * x2 * x2 * (x2 - 3.0 * x + 2.5), k * x2 * x * (6.0 * x2 - 15.0 * x + 10.0),
          k * 30.0 * x2 * (x2 - 2.0 * x + 1.0) / ramp};
}

SineTrajectory::Derivatives SineTrajectory::sum(const std::array<Sum, 3>& sines, double u) {
  Derivatives result{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  for (int i = 0; i < 3; ++i) {
    for (const Sine& sine : sines[i]) {
      const double w = sine.frequency, argument = w * u + sine.phase;
      const double s = sine.amplitude * std::sin(argument);
      result.value(i) += s;
      result.first(i) += w * sine.amplitude * std::cos(argument);
      result.second(i) -= w * w * s;
    }
  }
  return result;
}

SineTrajectory::Derivatives SineTrajectory::anglesAt(double u, const Derivatives& position) const {
  if (options_.kind != MotionKind::kPlanar) return sum(angles_, u);
  // Heading along the velocity with respect to u, which vanishes nowhere on the figure of eight.
  const Eigen::Vector3d& v = position.first;
  const Eigen::Vector3d& a = position.second;
  Derivatives result{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  result.value.z() = std::atan2(v.y(), v.x());
  result.first.z() = (v.x() * a.y() - v.y() * a.x()) / v.squaredNorm();
  return result;
}

SineTrajectory::Derivatives SineTrajectory::aboutPivot(const Derivatives& angles) const {
  const Eigen::Quaterniond R = frame_ * fromEuler(angles.value);
  const Eigen::Vector3d rate = angularVelocity(angles.value, angles.first);
  const Eigen::Vector3d acceleration = angularAcceleration(angles.value, angles.first, angles.second);
  const Eigen::Vector3d first = rate.cross(lever_);
  return {R * lever_, R * first, R * (acceleration.cross(lever_) + rate.cross(first))};
}

RigMotion SineTrajectory::at(TimeNs stamp) const {
  const double t = toSeconds(std::clamp(stamp, begin(), end()) - begin());
  const Warp warp = warpedTime(t);
  Derivatives position = sum(position_, warp.u);
  const Derivatives angles = anglesAt(warp.u, position);
  if (options_.kind == MotionKind::kPivot) position = aboutPivot(angles);
  position.value += drift_ * (warp.u - 0.5 * warpedTime(options_.duration).u);
  position.first += drift_;
  RigMotion motion;
  motion.T_WB = Transform(frame_ * fromEuler(angles.value) * mounting_, position.value);
  motion.velocity_W = position.first * warp.rate;
  motion.acceleration_W = position.second * warp.rate * warp.rate + position.first * warp.acceleration;
  motion.angular_velocity_B = mounting_.conjugate() * angularVelocity(angles.value, angles.first * warp.rate);
  return motion;
}

}  // namespace autocal_vio
