// One frame of the estimation problem: its states and what was measured there.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/imu/preintegration.h"

namespace autocal_vio {

using FrameId = std::int64_t;

/// What a frame in which the rig stands still says of its motion, docs/derivation.md (D35).
struct StandstillMeasurement {
  double sigma_velocity = 0.01;                              ///< of a velocity of zero [m/s]
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();  ///< mean reading while standing [rad/s]
  double sigma_gyroscope_bias = 1e3;                         ///< so large: no reading yet [rad/s]
};

struct FrameState {
  FrameId id = 0;
  TimeNs stamp = 0;           ///< of the image, camera clock
  double reference_td = 0.0;  ///< the states hold at IMU-clock time stamp + reference_td [s]
  std::array<double, 7> pose{{0, 0, 0, 0, 0, 0, 1}};  ///< T_WB: position [m], quaternion x y z w
  std::array<double, 9> motion{};                     ///< v_WB [m/s], b_g [rad/s], b_a [m/s^2]
  Eigen::Vector3d measured_angular_velocity =
      Eigen::Vector3d::Zero();                     ///< gyroscope at that time, with bias [rad/s]
  std::shared_ptr<Preintegration> preintegration;  ///< from the frame before; null at the first frame
  std::vector<Feature> features;
  std::optional<StandstillMeasurement> standstill;

  Eigen::Map<const Eigen::Vector3d> position() const {
    return Eigen::Map<const Eigen::Vector3d>(pose.data());
  }
  Eigen::Map<const Eigen::Quaterniond> rotation() const {
    return Eigen::Map<const Eigen::Quaterniond>(pose.data() + 3);
  }
  Eigen::Map<const Eigen::Vector3d> velocity() const {
    return Eigen::Map<const Eigen::Vector3d>(motion.data());
  }
  ImuBias bias() const {
    return ImuBias{Eigen::Map<const Eigen::Vector3d>(motion.data() + 3),
                   Eigen::Map<const Eigen::Vector3d>(motion.data() + 6)};
  }
  Transform T_WB() const { return Transform(Eigen::Quaterniond(rotation()), position()); }

  void setPose(const Transform& T_WB) {
    Eigen::Map<Eigen::Vector3d> p(pose.data());
    Eigen::Map<Eigen::Quaterniond> q(pose.data() + 3);
    p = T_WB.translation;
    q = T_WB.rotation;
  }
  void setMotion(const Eigen::Vector3d& velocity_W, const ImuBias& bias) {
    Eigen::Map<Vector9d> m(motion.data());
    m << velocity_W, bias.gyroscope, bias.accelerometer;
  }
};

/// Calibration states shared by all frames.
struct CalibrationState {
  std::array<double, 4> rotation{{0, 0, 0, 1}};  ///< R_BC, quaternion x y z w
  std::array<double, 3> translation{};           ///< p_BC [m]
  double td = 0.0;                               ///< t_imu = t_cam + td [s]
  bool rotation_held = false;                    ///< held parts are constants and keep every bit
  bool translation_held = false;
  bool td_held = false;

  Transform T_BC() const {
    Transform T_BC;  // filled part by part: its constructor normalises, and held parts keep every bit
    T_BC.rotation = Eigen::Map<const Eigen::Quaterniond>(rotation.data());
    T_BC.translation = Eigen::Map<const Eigen::Vector3d>(translation.data());
    return T_BC;
  }
  void setTransform(const Transform& T_BC) {
    Eigen::Map<Eigen::Quaterniond> q(rotation.data());
    Eigen::Map<Eigen::Vector3d> p(translation.data());
    q = T_BC.rotation;
    p = T_BC.translation;
  }
};

}  // namespace autocal_vio
