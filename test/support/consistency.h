// Errors of everything that is published against its published covariance, over one run.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/pipeline/vio_update.h"
#include "autocal_vio/sim/truth_sample.h"

namespace autocal_vio {

/// Mean of normalised squared errors per degree of freedom: 1 where the covariance is right.
struct Nees {
  double sum = 0.0;
  int count = 0;
  void add(double value) { sum += value, ++count; }
  void add(const Nees& other) { sum += other.sum, count += other.count; }
  double mean() const { return count > 0 ? sum / count : std::numeric_limits<double>::infinity(); }
};

template <int N>
double neesPerDof(const Eigen::Matrix<double, N, 1>& error, const Eigen::Matrix<double, N, N>& covariance) {
  return error.dot(covariance.ldlt().solve(error)) / N;
}

/// Takes each update with the truth of its image and keeps one sample a second.
///
/// Position and yaw are not observable: the truth is turned and shifted so that they agree at the odometry's origin,
/// where the estimate takes them for known. All else is compared as it is published.
class ConsistencyRecord {
 public:
  static constexpr double kInterval = 1.0;   // [s]
  static constexpr double kSettling = 10.0;  // [s] after the first odometry

  /// `rotation_floor`: sigma that the published R_BC has for errors of lens and images [rad]; the extrinsics are also
  /// looked at without it.
  explicit ConsistencyRecord(double rotation_floor) : rotation_floor_(rotation_floor) {}

  void add(const VioUpdate& update, const TruthSample& truth) {
    truth_.push_back(truth);
    if (!update.odometry) return;
    if (!first_) first_ = update.stamp;
    addExtrinsics(update.calibration, truth);
    const double since = toSeconds(update.stamp - *first_);
    if (since < kSettling || toSeconds(update.stamp - last_) < kInterval) return;
    last_ = update.stamp;
    if (origin_stamp_ != update.odometry->origin_stamp_imu) align(*update.odometry);
    addOdometry(*update.odometry, truth);
    addCalibration(update.calibration, truth);
  }

  const std::map<std::string, Nees>& nees() const { return nees_; }
  /// Of the last update: [p_BC in m, right perturbation of R_BC in rad].
  const Eigen::Matrix<double, 6, 1>& extrinsicsError() const { return extrinsics_error_; }
  const Eigen::Matrix<double, 6, 6>& extrinsicsCovariance() const { return extrinsics_covariance_; }
  bool hasOdometry() const { return first_.has_value(); }

 private:
  // The true pose a little before or after an image.
  static Transform truePose(const TruthSample& truth, TimeNs stamp_imu) {
    const double dt = toSeconds(stamp_imu - truth.stamp_imu);
    return Transform(truth.T_WB.rotation * expSo3((truth.angular_velocity_B * dt).eval()),
                     truth.T_WB.translation + truth.velocity_W * dt);
  }

  void align(const OdometryEstimate& odometry) {
    origin_stamp_ = odometry.origin_stamp_imu;
    const TruthSample* nearest = &truth_.front();
    for (const TruthSample& truth : truth_)
      if (std::abs(truth.stamp_imu - origin_stamp_) < std::abs(nearest->stamp_imu - origin_stamp_))
        nearest = &truth;
    const Transform T_WB = truePose(*nearest, origin_stamp_);
    // The turn about the vertical that leaves no rotation error about it.
    Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
    for (int i = 0; i < 10; ++i) {
      const double yaw = logSo3(odometry.T_odom_origin.rotation * (turn * T_WB.rotation).conjugate()).z();
      turn = Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ())) * turn;
    }
    T_odom_W_ = Transform(turn, odometry.T_odom_origin.translation - turn * T_WB.translation);
  }

  void addOdometry(const OdometryEstimate& odometry, const TruthSample& truth) {
    const Transform T_WB = T_odom_W_ * truePose(truth, odometry.stamp_imu);
    Eigen::Matrix<double, 6, 1> pose;
    pose << odometry.T_odom_imu.translation - T_WB.translation,
        logSo3(odometry.T_odom_imu.rotation * T_WB.rotation.conjugate());
    const Eigen::Vector3d velocity = odometry.velocity_W - T_odom_W_.rotation * truth.velocity_W;
    const Matrix6d P = odometry.covariance.topLeftCorner<6, 6>();
    nees_["pose"].add(neesPerDof<6>(pose, P));
    nees_["position"].add(neesPerDof<3>(pose.head<3>(), P.topLeftCorner<3, 3>()));
    nees_["attitude"].add(neesPerDof<3>(pose.tail<3>(), P.bottomRightCorner<3, 3>()));
    nees_["yaw"].add(pose(5) * pose(5) / P(5, 5));
    Eigen::Matrix<double, 3, 6> to_B;
    const Eigen::Matrix3d R_BW = odometry.T_odom_imu.rotationMatrix().transpose();
    to_B << R_BW * skew(odometry.velocity_W), R_BW;
    nees_["velocity in B"].add(neesPerDof<3>(
        R_BW * odometry.velocity_W - T_WB.rotation.conjugate() * (T_odom_W_.rotation * truth.velocity_W),
        to_B * odometry.covariance.block<6, 6>(3, 3) * to_B.transpose()));
    nees_["velocity"].add(neesPerDof<3>(velocity, odometry.covariance.block<3, 3>(6, 6)));
  }

  void addCalibration(const CalibrationEstimate& calibration, const TruthSample& truth) {
    const auto diagonal = [](const Eigen::Vector3d& error, const Eigen::Vector3d& sigma) {
      return error.cwiseQuotient(sigma).squaredNorm() / 3.0;
    };
    nees_["gyroscope bias"].add(
        diagonal(calibration.gyroscope_bias - truth.bias.gyroscope, calibration.sigma_gyroscope_bias));
    nees_["accelerometer bias"].add(diagonal(calibration.accelerometer_bias - truth.bias.accelerometer,
                                             calibration.sigma_accelerometer_bias));
    const Eigen::Matrix<double, 6, 1>& e = extrinsics_error_;
    nees_["extrinsics"].add(neesPerDof<6>(e, calibration.covariance));
    nees_["p_BC"].add(neesPerDof<3>(e.head<3>(), calibration.covariance.topLeftCorner<3, 3>()));
    nees_["R_BC"].add(neesPerDof<3>(e.tail<3>(), calibration.covariance.bottomRightCorner<3, 3>()));
    Matrix6d without_floor = calibration.covariance;
    without_floor.bottomRightCorner<3, 3>().diagonal().array() -= rotation_floor_ * rotation_floor_;
    nees_["extrinsics without floor"].add(neesPerDof<6>(e, without_floor));
    nees_["td"].add(std::pow((calibration.td - truth.td) / calibration.sigma_td, 2));
  }

  void addExtrinsics(const CalibrationEstimate& calibration, const TruthSample& truth) {
    extrinsics_error_ << calibration.T_imu_cam.translation - truth.T_imu_cam.translation,
        logSo3(truth.T_imu_cam.rotation.conjugate() * calibration.T_imu_cam.rotation);
    extrinsics_covariance_ = calibration.covariance;
  }

  double rotation_floor_;
  std::vector<TruthSample> truth_;
  std::optional<TimeNs> first_;
  TimeNs last_ = 0, origin_stamp_ = 0;
  Transform T_odom_W_;
  std::map<std::string, Nees> nees_;
  Eigen::Matrix<double, 6, 1> extrinsics_error_ = Eigen::Matrix<double, 6, 1>::Constant(1e3);
  Eigen::Matrix<double, 6, 6> extrinsics_covariance_ = Eigen::Matrix<double, 6, 6>::Identity();
};

}  // namespace autocal_vio
