// A closed-form trajectory, the IMU that flies it and the visual keyframes, for tests of the linear
// alignment.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/initializer/linear_alignment.h"

namespace autocal_vio {
namespace test {

/// Sums of sinusoids in position and in yaw, pitch, roll.
class SineTrajectory {
 public:
  explicit SineTrajectory(double translation = 1.0, double rotation = 1.0)
      : translation_(translation), rotation_(rotation) {}

  Eigen::Vector3d position(double t) const { return translation_ * sum(t, 0); }
  Eigen::Vector3d velocity(double t) const { return translation_ * sum(t, 1); }
  Eigen::Vector3d acceleration(double t) const { return translation_ * sum(t, 2); }

  Eigen::Quaterniond orientation(double t) const {
    const Eigen::Vector3d e = angles(t, 0);
    return Eigen::AngleAxisd(e(0), Eigen::Vector3d::UnitZ()) *
           Eigen::AngleAxisd(e(1), Eigen::Vector3d::UnitY()) *
           Eigen::AngleAxisd(e(2), Eigen::Vector3d::UnitX());
  }

  /// In the body frame [rad/s].
  Eigen::Vector3d angularVelocity(double t) const {
    const Eigen::Vector3d e = angles(t, 0), d = angles(t, 1);
    const double sp = std::sin(e(1)), cp = std::cos(e(1)), sr = std::sin(e(2)), cr = std::cos(e(2));
    return Eigen::Vector3d(d(2) - d(0) * sp, d(1) * cr + d(0) * sr * cp, -d(1) * sr + d(0) * cr * cp);
  }

 private:
  // Derivative of order `order` of amplitude * sin(rate * t + phase).
  static double sine(double amplitude, double rate, double phase, double t, int order) {
    return amplitude * std::pow(rate, order) * std::sin(rate * t + phase + order * M_PI / 2.0);
  }
  static Eigen::Vector3d sum(double t, int order) {
    return Eigen::Vector3d(sine(1.2, 1.1, 0.3, t, order) + sine(0.15, 4.1, 1.0, t, order),
                           sine(0.9, 1.7, 1.3, t, order) + sine(0.12, 3.7, 0.2, t, order),
                           sine(0.5, 1.4, 2.1, t, order) + sine(0.10, 4.7, 2.0, t, order));
  }
  Eigen::Vector3d angles(double t, int order) const {
    return rotation_ * Eigen::Vector3d(sine(0.7, 0.9, 0.1, t, order) + sine(0.1, 3.1, 0.7, t, order),
                                       sine(0.35, 1.3, 0.9, t, order) + sine(0.1, 3.9, 1.9, t, order),
                                       sine(0.4, 1.6, 1.7, t, order) + sine(0.1, 3.4, 2.7, t, order));
  }

  double translation_;
  double rotation_;
};

struct SceneOptions {
  int keyframes = 20;
  double interval = 0.2;    ///< between keyframes [s]
  double imu_rate = 200.0;  ///< [Hz]
  double scale = 2.5;       ///< [m per structure unit]
  double gravity = 9.81;
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d p_BC = Eigen::Vector3d(0.11, -0.07, 0.04);
  double sigma_position = 0.0;  ///< noise of p_VC [structure units]
  double sigma_rotation = 0.0;  ///< noise of R_VC [rad]
  bool imu_noise = false;
  /// Keyframe states follow from the preintegrated increments instead of the closed form: then the data are
  /// exact to rounding at any IMU rate.
  bool propagate = false;
  unsigned seed = 1;
};

/// Input and truth. V is the first camera's frame turned by an arbitrary rotation.
struct Scene {
  std::vector<AlignmentKeyframe> keyframes;
  std::vector<Preintegration> preintegrations;
  Eigen::Quaterniond R_BC = Eigen::Quaterniond(0.5, -0.52, 0.48, -0.5).normalized();
  Eigen::Vector3d g_V = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3d> velocities_V;

  AlignmentInput input() const { return AlignmentInput{keyframes, preintegrations, R_BC}; }
};

class SceneMaker {
 public:
  SceneMaker(const SceneOptions& options, const SineTrajectory& trajectory)
      : options_(options), trajectory_(trajectory), random_(options.seed) {}

  Scene make() {
    Scene scene;
    const TimeNs step = fromSeconds(options_.interval);
    for (int k = 0; k + 1 < options_.keyframes; ++k)
      scene.preintegrations.emplace_back(samples(k * step, (k + 1) * step), ImuBias(), ImuNoise());
    const Eigen::Quaterniond R_VW = Eigen::Quaterniond(0.3, 0.8, -0.4, 0.33).normalized();
    const Eigen::Vector3d p_VW(0.4, -0.2, 0.7);
    const Eigen::Vector3d g_W(0.0, 0.0, -options_.gravity);
    scene.g_V = R_VW * g_W;
    Eigen::Quaterniond R_WB = trajectory_.orientation(0.0);
    Eigen::Vector3d p_WB = trajectory_.position(0.0), v_W = trajectory_.velocity(0.0);
    for (int k = 0; k < options_.keyframes; ++k) {
      const double t = toSeconds(k * step);
      if (!options_.propagate) {
        R_WB = trajectory_.orientation(t);
        p_WB = trajectory_.position(t);
        v_W = trajectory_.velocity(t);
      }
      AlignmentKeyframe keyframe;
      keyframe.stamp = k * step;
      keyframe.R_VC = R_VW * R_WB * scene.R_BC * expSo3((options_.sigma_rotation * normal()).eval());
      keyframe.p_VC =
          R_VW * (p_WB + R_WB * options_.p_BC) / options_.scale + p_VW + options_.sigma_position * normal();
      scene.keyframes.push_back(keyframe);
      scene.velocities_V.push_back(R_VW * v_W);
      if (k + 1 == options_.keyframes) break;
      const double dt = scene.preintegrations[k].duration();
      ImuBias bias;
      bias.accelerometer = options_.accelerometer_bias;
      const ImuIncrement d = scene.preintegrations[k].corrected(bias);
      p_WB = p_WB + v_W * dt + 0.5 * g_W * dt * dt + R_WB * d.position;
      v_W = v_W + g_W * dt + R_WB * d.velocity;
      R_WB = (R_WB * d.rotation).normalized();
    }
    return scene;
  }

 private:
  std::vector<ImuSample> samples(TimeNs begin, TimeNs end) {
    const TimeNs step = fromSeconds(1.0 / options_.imu_rate);
    const ImuNoise noise;
    const double root = std::sqrt(options_.imu_rate);
    std::vector<ImuSample> result;
    for (TimeNs stamp = begin; stamp <= end; stamp += step) {
      const double t = toSeconds(stamp);
      ImuSample sample;
      sample.stamp = stamp;
      sample.angular_velocity = trajectory_.angularVelocity(t);
      sample.acceleration = trajectory_.orientation(t).conjugate() *
                                (trajectory_.acceleration(t) + Eigen::Vector3d(0.0, 0.0, options_.gravity)) +
                            options_.accelerometer_bias;
      if (options_.imu_noise) {
        sample.angular_velocity += noise.gyroscope_noise_density * root * normal();
        sample.acceleration += noise.accelerometer_noise_density * root * normal();
      }
      result.push_back(sample);
    }
    return result;
  }

  Eigen::Vector3d normal() {
    const double x = gauss_(random_), y = gauss_(random_), z = gauss_(random_);
    return Eigen::Vector3d(x, y, z);
  }

  SceneOptions options_;
  SineTrajectory trajectory_;
  std::mt19937 random_;
  std::normal_distribution<double> gauss_{0.0, 1.0};
};

inline Scene makeScene(const SceneOptions& options, const SineTrajectory& trajectory = SineTrajectory()) {
  return SceneMaker(options, trajectory).make();
}

/// Angle between two vectors [rad].
inline double angleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace test
}  // namespace autocal_vio
