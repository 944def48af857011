#include <gtest/gtest.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <Eigen/Eigenvalues>
#include <limits>
#include <random>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/ros/base_frame.h"
#include "autocal_vio/ros/input_conversions.h"
#include "autocal_vio/ros/output_conversions.h"
#include "autocal_vio/ros/path_recorder.h"

namespace autocal_vio {
namespace {

template <class Array>
Matrix6d toMatrix(const Array& covariance) {
  Matrix6d matrix;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) matrix(i, j) = covariance[6 * i + j];
  }
  return matrix;
}

Matrix6d somePositiveMatrix() {
  Matrix6d A;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) A(i, j) = 0.01 * ((7 * i + 3 * j) % 11 - 5);
  }
  return A * A.transpose() + Matrix6d::Identity() * 1e-4;
}

MotionState someMotion() {
  MotionState state;
  state.T_WB = Transform(expSo3(Eigen::Vector3d(0.3, -0.5, 1.1)), Eigen::Vector3d(1.0, 2.0, 3.0));
  state.velocity_W << 0.5, -1.0, 0.2;
  state.angular_velocity_B << 0.1, 0.4, -0.3;
  state.covariance.topLeftCorner<6, 6>() = somePositiveMatrix();
  state.covariance.block<3, 3>(6, 6) = Eigen::Vector3d(0.01, 0.02, 0.03).asDiagonal();
  return state;
}

TEST(OdometryConversion, PoseInOdomTwistInChild) {
  MotionState state = someMotion();
  state.covariance.block<3, 3>(3, 3).setZero();
  const Eigen::Matrix3d angular = Eigen::Matrix3d::Identity() * 1e-5;
  const nav_msgs::Odometry message =
      toOdometry(ros::Time(5, 6), state, angular, {"odom", "imu", Transform()});
  EXPECT_EQ(message.header.frame_id, "odom");
  EXPECT_EQ(message.child_frame_id, "imu");
  EXPECT_EQ(message.header.stamp, ros::Time(5, 6));
  EXPECT_DOUBLE_EQ(message.pose.pose.position.y, 2.0);
  EXPECT_DOUBLE_EQ(message.pose.pose.orientation.w, state.T_WB.rotation.w());
  EXPECT_LT((toMatrix(message.pose.covariance) - state.covariance.topLeftCorner<6, 6>()).norm(), 1e-15);
  const Eigen::Vector3d linear(message.twist.twist.linear.x, message.twist.twist.linear.y,
                               message.twist.twist.linear.z);
  EXPECT_LT((state.T_WB.rotation * linear - state.velocity_W).norm(), 1e-14);
  EXPECT_DOUBLE_EQ(message.twist.twist.angular.z, -0.3);
  const Eigen::Matrix3d R = state.T_WB.rotationMatrix();
  const Matrix6d twist = toMatrix(message.twist.covariance);
  EXPECT_LT((R * twist.topLeftCorner<3, 3>() * R.transpose() - state.covariance.block<3, 3>(6, 6)).norm(),
            1e-15);
  EXPECT_LT((twist.bottomRightCorner<3, 3>() - angular).norm(), 1e-18);
}

/// The base's pose and twist differ from the IMU's by the lever arm; checked by differences.
TEST(OdometryConversion, BaseFrameMovesRigidlyWithTheImu) {
  const MotionState state = someMotion();
  const Transform T_imu_base(expSo3(Eigen::Vector3d(-0.2, 0.7, 0.4)), Eigen::Vector3d(0.3, -0.1, 0.2));
  const OdometryFrames frames{"odom", "base_link", T_imu_base};
  const nav_msgs::Odometry message =
      toOdometry(ros::Time(1), state, Eigen::Matrix3d::Identity() * 1e-5, frames);
  const double dt = 1e-6;
  const Transform later(state.T_WB.rotation * expSo3(Eigen::Vector3d(state.angular_velocity_B * dt)),
                        state.T_WB.translation + state.velocity_W * dt);
  const Transform base = state.T_WB * T_imu_base, base_later = later * T_imu_base;
  const Eigen::Vector3d velocity =
      base.rotation.conjugate() * Eigen::Vector3d((base_later.translation - base.translation) / dt);
  const Eigen::Vector3d rate =
      logSo3(Eigen::Quaterniond(base.rotation.conjugate() * base_later.rotation)) / dt;
  EXPECT_NEAR(message.pose.pose.position.x, base.translation.x(), 1e-12);
  EXPECT_NEAR(message.twist.twist.linear.x, velocity.x(), 1e-6);
  EXPECT_NEAR(message.twist.twist.linear.y, velocity.y(), 1e-6);
  EXPECT_NEAR(message.twist.twist.linear.z, velocity.z(), 1e-6);
  EXPECT_NEAR(message.twist.twist.angular.x, rate.x(), 1e-6);
  EXPECT_NEAR(message.twist.twist.angular.y, rate.y(), 1e-6);
}

TEST(BaseFrame, ComesFromTheRobotDescription) {
  const UrdfText robot{R"(<robot name="r"><link name="base_link"/><link name="imu"/><link name="turret"/>
    <joint name="a" type="fixed"><parent link="base_link"/><child link="imu"/><origin xyz="0.1 0.2 0.3"/></joint>
    <joint name="yaw_joint" type="continuous"><parent link="base_link"/><child link="turret"/></joint></robot>)",
                       "robot_description"};
  std::string problem;
  BaseFrame fixed("base_link", robot);
  const std::optional<Transform> T_imu_base = fixed.inImu("imu", &problem);
  ASSERT_TRUE(T_imu_base) << problem;
  EXPECT_LT((T_imu_base->translation - Eigen::Vector3d(-0.1, -0.2, -0.3)).norm(), 1e-12);
  EXPECT_EQ(fixed.childFrame("imu"), "base_link");
  BaseFrame turning("turret", robot);
  for (int i = 0; i < 2; ++i) {
    problem.clear();
    EXPECT_FALSE(turning.inImu("imu", &problem));
    EXPECT_NE(problem.find("yaw_joint"), std::string::npos) << problem;
  }
  BaseFrame imu("imu", robot), none("", std::nullopt);
  EXPECT_TRUE(imu.inImu("imu", &problem));
  EXPECT_TRUE(none.inImu("imu", &problem));
  EXPECT_EQ(none.childFrame("imu"), "imu");
}

TEST(BaseFrame, ThatMovesInTfIsNamedAndNotUsed) {
  for (const bool moves : {false, true}) {
    int asked = 0;
    const TfLookup tf = [&](const std::string& target, const std::string& source) {
      if (++asked == 1) throw tf2::LookupException("not yet");
      EXPECT_EQ(target + " " + source, "imu base_link");
      geometry_msgs::TransformStamped found;
      found.transform.rotation.w = 1.0;
      found.transform.translation.x = 0.1 + (moves && asked > 50 ? 0.01 : 0.0);
      return found;
    };
    BaseFrame frame("base_link", std::nullopt, tf);
    std::string problem;
    EXPECT_FALSE(frame.inImu("imu", &problem));
    EXPECT_NE(problem.find("not yet"), std::string::npos) << problem;
    const auto first = frame.inImu("imu", &problem);
    ASSERT_TRUE(first);
    EXPECT_EQ(first->translation.x(), 0.1);
    for (int i = 0; i < 1000; ++i) frame.inImu("imu", &problem);
    problem.clear();
    EXPECT_EQ(frame.inImu("imu", &problem).has_value(), !moves);
    EXPECT_EQ(problem.find("moves on 'imu'") != std::string::npos, moves) << problem;
    EXPECT_LT(asked, 300) << "asked for ever";
  }
}

TEST(OdometryConversion, CovarianceOfTheBaseMatchesMonteCarlo) {
  const MotionState state = someMotion();
  const Transform T_imu_base(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.3, -0.1, 0.2));
  const nav_msgs::Odometry message =
      toOdometry(ros::Time(1), state, Eigen::Matrix3d::Identity() * 1e-5, {"odom", "base", T_imu_base});
  const Matrix6d L = Matrix6d(state.covariance.topLeftCorner<6, 6>() * 1e-4).llt().matrixL();
  std::mt19937 generator(3);
  std::normal_distribution<double> normal;
  Matrix6d sum = Matrix6d::Zero();
  constexpr int kRuns = 20000;
  const Transform base = state.T_WB * T_imu_base;
  for (int run = 0; run < kRuns; ++run) {
    Eigen::Matrix<double, 6, 1> white;
    for (int k = 0; k < 6; ++k) white(k) = normal(generator);
    const Eigen::Matrix<double, 6, 1> e = L * white;
    const Transform disturbed(expSo3(Eigen::Vector3d(e.tail<3>())) * state.T_WB.rotation,
                              state.T_WB.translation + e.head<3>());
    Eigen::Matrix<double, 6, 1> error;
    error.head<3>() = (disturbed * T_imu_base).translation - base.translation;
    error.tail<3>() = e.tail<3>();
    sum += error * error.transpose();
  }
  const Matrix6d sampled = sum / kRuns, expected = toMatrix(message.pose.covariance) * 1e-4;
  EXPECT_LT((sampled - expected).norm() / expected.norm(), 0.05);
}

/// docs/derivation.md (D69). Attitude, velocity and rate off by what their covariances say, the first two correlated: the twist of the base.
TEST(OdometryConversion, CovarianceOfTheTwistMatchesMonteCarlo) {
  MotionState state = someMotion();
  state.covariance.block<6, 6>(3, 3) = 1e-4 * somePositiveMatrix();
  const Eigen::Matrix3d angular = Eigen::Vector3d(1e-4, 3e-4, 2e-4).asDiagonal();
  const Transform T_imu_base(expSo3(Eigen::Vector3d(-0.2, 0.7, 0.4)), Eigen::Vector3d(0.3, -0.5, 0.2));
  const OdometryFrames frames{"odom", "base", T_imu_base};
  const auto twist = [&](const MotionState& s) {
    const geometry_msgs::Twist t = toOdometry(ros::Time(1), s, angular, frames).twist.twist;
    Eigen::Matrix<double, 6, 1> result;
    result << t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z;
    return result;
  };
  const Matrix6d half = Matrix6d(state.covariance.block<6, 6>(3, 3)).llt().matrixL();
  std::mt19937 generator(4);
  std::normal_distribution<double> normal;
  const auto draw = [&] { return normal(generator); };
  Matrix6d sum = Matrix6d::Zero();
  constexpr int kRuns = 20000;
  for (int run = 0; run < kRuns; ++run) {
    const Eigen::Matrix<double, 6, 1> e = half * Eigen::Matrix<double, 6, 1>::NullaryExpr(draw);
    MotionState disturbed = state;
    disturbed.T_WB.rotation = expSo3(Eigen::Vector3d(e.head<3>())) * state.T_WB.rotation;
    disturbed.velocity_W += e.tail<3>();
    disturbed.angular_velocity_B += angular.cwiseSqrt() * Eigen::Vector3d::NullaryExpr(draw);
    const Eigen::Matrix<double, 6, 1> error = twist(disturbed) - twist(state);
    sum += error * error.transpose();
  }
  const Matrix6d sampled = sum / kRuns,
                 expected = toMatrix(toOdometry(ros::Time(1), state, angular, frames).twist.covariance);
  EXPECT_LT((sampled - expected).norm() / expected.norm(), 0.05);
  const Eigen::Matrix3d cross = expected.topRightCorner<3, 3>(),
                        sampled_cross = sampled.topRightCorner<3, 3>();
  EXPECT_LT((sampled_cross - cross).norm() / cross.norm(), 0.1);
}

TEST(OdometryConversion, RecognisesWhatIsNotFinite) {
  MotionState state = someMotion();
  EXPECT_TRUE(
      isFinite(toOdometry(ros::Time(1), state, Eigen::Matrix3d::Identity(), {"a", "b", Transform()})));
  state.velocity_W.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(
      isFinite(toOdometry(ros::Time(1), state, Eigen::Matrix3d::Identity(), {"a", "b", Transform()})));
  state = someMotion();
  state.T_WB.rotation.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(
      isFinite(toOdometry(ros::Time(1), state, Eigen::Matrix3d::Identity(), {"a", "b", Transform()})));
}

TEST(ExtrinsicsConversion, TurnsTheCovarianceToTheImusAxes) {
  VioUpdate update;
  update.stamp = 7 * kNsPerSecond;
  // The camera's z axis is the IMU's x axis: an error about the camera's z is one about the IMU's x.
  Eigen::Matrix3d R_BC;
  R_BC << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  update.calibration.T_imu_cam = Transform(R_BC, Eigen::Vector3d(0.1, 0.2, 0.3));
  update.calibration.covariance.setZero();
  update.calibration.covariance.diagonal() << 1e-4, 2e-4, 3e-4, 1e-6, 2e-6, 9e-6;
  const geometry_msgs::PoseWithCovarianceStamped message = toExtrinsics(update, "imu0");
  EXPECT_EQ(message.header.frame_id, "imu0");
  EXPECT_EQ(message.header.stamp, ros::Time(7));
  EXPECT_DOUBLE_EQ(message.pose.pose.position.z, 0.3);
  const Matrix6d covariance = toMatrix(message.pose.covariance);
  EXPECT_NEAR(covariance(1, 1), 2e-4, 1e-18);
  EXPECT_NEAR(covariance(3, 3), 9e-6, 1e-18);
  EXPECT_NEAR(covariance(4, 4), 1e-6, 1e-18);
  EXPECT_NEAR(covariance(5, 5), 2e-6, 1e-18);
  const CalibrationStatus status = toStatus(update, "imu0");
  EXPECT_NEAR(status.sigma_rotation[0], 3e-3, 1e-15);
  EXPECT_NEAR(status.sigma_translation[0], 1e-2, 1e-15);
}

TEST(StatusConversion, NamesItsStatesAsTheContract) {
  VioUpdate update;
  const std::pair<VioState, std::string> states[] = {
      {VioState::kWaitingForData, CalibrationStatus::WAITING_FOR_DATA},
      {VioState::kCalibratingRotation, CalibrationStatus::CALIBRATING_ROTATION},
      {VioState::kCalibratingTranslation, CalibrationStatus::CALIBRATING_TRANSLATION},
      {VioState::kEstimating, CalibrationStatus::ESTIMATING},
      {VioState::kConverged, CalibrationStatus::CONVERGED},
      {VioState::kFrozen, CalibrationStatus::FROZEN},
      {VioState::kLost, CalibrationStatus::LOST}};
  for (const auto& [state, name] : states) {
    update.state = state;
    EXPECT_EQ(toStatus(update, "imu").state, name);
  }
}

TEST(StatusConversion, CarriesFiniteNumbersOnly) {
  VioUpdate update;
  const double infinity = std::numeric_limits<double>::infinity();
  update.calibration.sigma_td = infinity;
  update.calibration.sigma_gyroscope_bias.setConstant(infinity);
  update.calibration.covariance(2, 2) = std::numeric_limits<double>::quiet_NaN();
  update.calibration.td = 0.003;
  update.counters.imu_unusable = 2;
  update.counters.imu_out_of_order = 3;
  const CalibrationStatus status = toStatus(update, "imu");
  EXPECT_DOUBLE_EQ(status.sigma_time_offset, 1e6);
  EXPECT_DOUBLE_EQ(status.sigma_gyroscope_bias.y, 1e6);
  EXPECT_DOUBLE_EQ(status.sigma_translation[2], 1e3);
  EXPECT_DOUBLE_EQ(status.time_offset, 0.003);
  EXPECT_EQ(status.imu_dropped, 5u);
}

TEST(PointCloud, CarriesThePoints) {
  const sensor_msgs::PointCloud2 cloud =
      toPointCloud({Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(4, 5, 6)}, ros::Time(3), "odom");
  EXPECT_EQ(cloud.width * cloud.height, 2u);
  EXPECT_EQ(cloud.header.frame_id, "odom");
  sensor_msgs::PointCloud2ConstIterator<float> z(cloud, "z");
  ++z;
  EXPECT_FLOAT_EQ(*z, 6.0f);
}

TEST(PathRecorder, IsBoundedAndStartsAnewWhenTimeGoesBack) {
  PathRecorder path(5);
  nav_msgs::Odometry odometry;
  odometry.header.frame_id = "odom";
  EXPECT_FALSE(path.due());
  for (int i = 0; i < 40; ++i) {  // 20 Hz: every other pose is kept
    odometry.header.stamp = toRosTime(kNsPerSecond + i * kNsPerSecond / 20);
    odometry.pose.pose.position.x = i;
    path.add(odometry);
  }
  const nav_msgs::PathPtr message = path.due();
  ASSERT_TRUE(message);
  ASSERT_EQ(message->poses.size(), 5u);
  EXPECT_EQ(message->header.frame_id, "odom");
  EXPECT_DOUBLE_EQ(message->poses.back().pose.position.x, 38);
  EXPECT_DOUBLE_EQ(message->poses.front().pose.position.x, 30);
  EXPECT_FALSE(path.due());
  odometry.header.stamp = ros::Time(0, 500);
  path.add(odometry);
  const nav_msgs::PathPtr anew = path.due();
  ASSERT_TRUE(anew);
  EXPECT_EQ(anew->poses.size(), 1u);
}

}  // namespace
}  // namespace autocal_vio
