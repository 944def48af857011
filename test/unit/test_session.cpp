// One session alone: from nothing to an estimate, to its loss.
#include "autocal_vio/common/angle.h"
#include "autocal_vio/pipeline/session.h"

#include <gtest/gtest.h>

#include <cmath>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {
namespace {

constexpr TimeNs kAhead = 50000000;  // of IMU samples before the image: any time offset is covered

class SessionTest : public ::testing::Test {
 protected:
  // Made once; with the true extrinsics as a prior, so that the estimate begins early.
  static void SetUpTestSuite() {
    FeatureSimulationOptions options = FeatureSimulationOptions::euroc(3);
    options.motion.duration = 8.0;
    data_ = new FeatureDataset(simulateFeatures(options));
  }
  static void TearDownTestSuite() { delete data_; }

  static RigModel rig() {
    RigModel rig = data_->rig.rig;
    rig.extrinsics_prior = ExtrinsicsPrior{data_->rig.T_imu_cam, 0.5 * kDegree, 0.01};
    return rig;
  }

  static Session makeSession(const std::optional<Transform>& start = std::nullopt) {
    return Session(CameraModel(*data_->rig.rig.camera).focalLength(), rig(), VioOptions(), start);
  }

  // Feeds the images up to `seconds`, with IMU samples as far as `imu_seconds`; false once the session is lost.
  bool feed(Session* session, double seconds, double imu_seconds = 1e9) {
    const TimeNs begin = data_->frames.front().stamp;
    for (; frame_ < data_->frames.size(); ++frame_) {
      const FeatureFrame& frame = data_->frames[frame_];
      if (toSeconds(frame.stamp - begin) > seconds) break;
      while (sample_ < data_->imu.size() && data_->imu[sample_].stamp <= frame.stamp + kAhead) {
        if (toSeconds(data_->imu[sample_].stamp - begin) <= imu_seconds) imu_.add(data_->imu[sample_]);
        ++sample_;
      }
      update_ = VioUpdate();
      update_.stamp = frame.stamp;
      if (!session->process(frame, imu_, &update_)) return false;
      if (update_.odometry && !first_) first_ = update_.odometry->T_odom_imu;
    }
    return true;
  }

  // From the first image again.
  void restart() {
    frame_ = sample_ = 0;
    imu_ = ImuBuffer(30 * kNsPerSecond);
    first_.reset();
  }

  static FeatureDataset* data_;
  ImuBuffer imu_{30 * kNsPerSecond};
  std::size_t frame_ = 0, sample_ = 0;
  VioUpdate update_;
  std::optional<Transform> first_;  // pose of the first odometry
};

FeatureDataset* SessionTest::data_ = nullptr;

TEST_F(SessionTest, BeforeTheFirstEstimateItKnowsWhatItWasGiven) {
  Session session = makeSession();
  EXPECT_FALSE(session.estimating());
  EXPECT_FALSE(session.knowledge());
  EXPECT_FALSE(session.lastPose());
  EXPECT_EQ(session.wanderingTracks(), nullptr);
  EXPECT_EQ(session.td(), rig().time_offset_prior.td);
  ASSERT_TRUE(feed(&session, 0.2));
  EXPECT_EQ(update_.state, VioState::kCalibratingTranslation);
  EXPECT_FALSE(update_.odometry);
  EXPECT_FALSE(update_.reason.empty());
  EXPECT_TRUE(update_.calibration.T_imu_cam.translation.isApprox(data_->rig.T_imu_cam.translation));
}

TEST_F(SessionTest, PredictsTheCamerasRotation) {
  Session session = makeSession();
  ASSERT_TRUE(feed(&session, 7.01));
  ASSERT_TRUE(session.estimating());
  const std::size_t i = frame_ - 5, j = frame_ - 1;
  const auto predicted = session.predictedRotation(data_->truth[i].stamp, data_->truth[j].stamp, imu_);
  ASSERT_TRUE(predicted);
  const Eigen::Quaterniond R_WCi = data_->truth[i].T_WB.rotation * data_->rig.T_imu_cam.rotation;
  const Eigen::Quaterniond R_WCj = data_->truth[j].T_WB.rotation * data_->rig.T_imu_cam.rotation;
  EXPECT_LT(R_WCi.conjugate().angularDistance(Eigen::Quaterniond(*predicted) * R_WCj.conjugate()),
            0.3 * kDegree);
  EXPECT_FALSE(session.predictedRotation(data_->truth[j].stamp, data_->truth[j].stamp + kNsPerSecond, imu_))
      << "the IMU does not reach there";
}

TEST_F(SessionTest, TheOdometryBeginsWhereTheLastOneEnded) {
  const Eigen::Quaterniond heading(Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitZ()));
  const Transform start(heading, Eigen::Vector3d(3.0, -2.0, 1.0));
  Session from_nowhere = makeSession();
  ASSERT_TRUE(feed(&from_nowhere, 7.01));
  const OdometryEstimate there = update_.odometry.value();
  restart();
  Session session = makeSession(start);
  ASSERT_TRUE(feed(&session, 7.01));
  ASSERT_TRUE(first_);
  EXPECT_LT((first_->translation - start.translation).norm(), 1e-9);
  const Eigen::Matrix3d turn = (first_->rotation * heading.conjugate()).toRotationMatrix();
  EXPECT_NEAR(std::atan2(turn(1, 0) - turn(0, 1), turn(0, 0) + turn(1, 1)), 0.0, 1e-6) << "another heading";
  // The same estimate in other axes, with the covariance in them.
  const OdometryEstimate& here = update_.odometry.value();
  Matrix15d J = Matrix15d::Identity();
  for (const int block : {0, 3, 6})
    J.block<3, 3>(block, block) =
        (here.T_odom_imu.rotation * there.T_odom_imu.rotation.conjugate()).toRotationMatrix();
  EXPECT_LT((here.covariance - J * there.covariance * J.transpose()).norm(), 1e-6 * here.covariance.norm());
  EXPECT_GT((here.covariance - there.covariance).block(3, 3, 3, 3).norm(), 0.0);
  const ImuNoise& noise = rig().imu_noise;
  const double white = noise.gyroscope_noise_density * std::sqrt(noise.update_rate);
  EXPECT_GT(here.angular_velocity_covariance_B.diagonal().minCoeff(), 0.5 * white * white);
}

// It is that of the last keyframe, in the axes of the odometry frame: those of the body turn on with every image.
TEST_F(SessionTest, TheCovarianceDoesNotTurnWithTheBody) {
  Session session = makeSession();
  ASSERT_TRUE(feed(&session, 5.0));
  Matrix15d before = update_.odometry.value().covariance;
  int same = 0, images = 0;
  for (double t = 5.06; t < 7.9; t += 0.05, ++images) {
    ASSERT_TRUE(feed(&session, t));
    const Matrix15d& now = update_.odometry.value().covariance;
    same += now == before;
    before = now;
  }
  EXPECT_GT(same, images / 4);
  EXPECT_LT(same, images);
}

TEST_F(SessionTest, WhatItKnowsOutlivesALossForWantOfData) {
  Session session = makeSession();
  ASSERT_TRUE(feed(&session, 6.0));
  ASSERT_TRUE(session.knowledge());
  const CalibrationKnowledge before = *session.knowledge();
  const Transform pose = *session.lastPose();
  EXPECT_GT(before.extrinsics.sigma_rotation, 0.0);
  EXPECT_LT(before.extrinsics.sigma_rotation, 0.5 * kDegree);
  EXPECT_LT(before.extrinsics.sigma_translation, 0.01);
  EXPECT_FALSE(feed(&session, 8.0, 6.0)) << "no IMU samples after 6 s";
  EXPECT_EQ(update_.state, VioState::kLost);
  EXPECT_FALSE(update_.reason.empty());
  ASSERT_TRUE(session.knowledge());
  // To the bit what the last update said, which the loss repeats.
  const ExtrinsicsPrior after = session.knowledge()->extrinsics;
  EXPECT_TRUE(
      (after.T_imu_cam.translation.array() == update_.calibration.T_imu_cam.translation.array()).all());
  EXPECT_TRUE(
      (after.T_imu_cam.rotation.coeffs().array() == update_.calibration.T_imu_cam.rotation.coeffs().array())
          .all());
  EXPECT_LE(after.sigma_translation, 1.05 * before.extrinsics.sigma_translation);
  EXPECT_LT((session.lastPose()->translation - pose.translation).norm(), 0.5);
}

TEST_F(SessionTest, HeldExtrinsicsAreFrozenAndReleasedOnesEstimated) {
  Session session = makeSession();
  session.hold({true, true, false});
  ASSERT_TRUE(feed(&session, 6.0));
  EXPECT_EQ(update_.state, VioState::kFrozen);
  EXPECT_TRUE(update_.calibration.T_imu_cam.translation.isApprox(data_->rig.T_imu_cam.translation, 0.0));
  session.hold({false, false, false});
  ASSERT_TRUE(feed(&session, 7.8)) << update_.reason;
  EXPECT_NE(update_.state, VioState::kFrozen);
  EXPECT_FALSE(update_.calibration.T_imu_cam.translation.isApprox(data_->rig.T_imu_cam.translation, 0.0));
}

TEST_F(SessionTest, ReleasedExtrinsicsAreNotCalledPerfect) {
  Session session = makeSession();
  ASSERT_TRUE(feed(&session, 4.5));
  session.hold({true, true, true});
  ASSERT_TRUE(feed(&session, 7.01));
  // Again and again: between keyframes, too.
  for (double t = 7.06; t < 7.5; t += 0.05) {
    session.hold({false, false, false});
    ASSERT_TRUE(feed(&session, t));
    EXPECT_NE(update_.state, VioState::kFrozen);
    EXPECT_EQ(update_.reason.find("known to 0 "), std::string::npos) << t << ": " << update_.reason;
    session.hold({true, true, true});
    ASSERT_TRUE(feed(&session, t += 0.05));
    EXPECT_EQ(update_.state, VioState::kFrozen);
  }
}

// Held at a first rough value it is frozen, not found out: "translation to 0 mm" it was once, and converged.
TEST_F(SessionTest, AHeldPartIsNeverCalledConverged) {
  Session session = makeSession();
  ASSERT_TRUE(feed(&session, 2.5));
  for (double t = 2.5; !session.estimating() && t < 7.0; t += 0.05) ASSERT_TRUE(feed(&session, t));
  ASSERT_TRUE(session.estimating());
  session.hold({false, true, false});
  const double sigma = session.knowledge()->extrinsics.sigma_translation;
  ASSERT_TRUE(feed(&session, 7.9));
  EXPECT_EQ(update_.state, VioState::kFrozen);
  EXPECT_EQ(update_.reason.find("held: translation (sigma "), 0U) << update_.reason;
  EXPECT_EQ(update_.reason.find("translation to"), std::string::npos) << update_.reason;
  EXPECT_NEAR(session.knowledge()->extrinsics.sigma_translation, sigma, 1e-9);
}

// docs/derivation.md (D66): the share of the images.
TEST_F(SessionTest, TheRotationIsNeverKnownBetterThanTheImagesAre) {
  const double focal_length = CameraModel(*data_->rig.rig.camera).focalLength();
  const auto leastSigma = [&](double image_accuracy) {
    VioOptions options;
    options.estimator.image_accuracy = image_accuracy;
    Session session(focal_length, rig(), options, std::nullopt);
    frame_ = sample_ = 0;
    imu_ = ImuBuffer(30 * kNsPerSecond);
    EXPECT_TRUE(feed(&session, 7.0));
    EXPECT_TRUE(session.estimating());
    return std::sqrt(update_.calibration.covariance.diagonal().tail<3>().minCoeff());
  };
  const double floor = 2.0 / focal_length, without = leastSigma(0.0), with = leastSigma(2.0);
  EXPECT_LT(without, floor);
  EXPECT_NEAR(with, std::hypot(without, floor), 1e-9);
}

}  // namespace
}  // namespace autocal_vio
