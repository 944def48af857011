// A feature-level simulation as a stream of messages that can be damaged, and what VioSystem makes of it.
//
//   Stream stream(simulateFeatures(...));
//   stream.removeImu(12.0, 13.0);                    // seconds after the first image
//   FaultRun run = runStream(stream, rig, options);  // asserts that nothing in any update is not finite
#pragma once

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/pipeline/vio_system.h"
#include "autocal_vio/sim/feature_simulator.h"

namespace autocal_vio {

struct StreamedFrame {
  FeatureFrame frame;
  std::size_t index = 0;  ///< into the dataset's truth
};

/// A message; `time` is when it was recorded, in seconds after the first image, and outlives changes of its stamp.
struct StreamEvent {
  double time = 0.0;
  std::variant<ImuSample, StreamedFrame> message;

  bool isImu() const { return std::holds_alternative<ImuSample>(message); }
  ImuSample& imu() { return std::get<ImuSample>(message); }
  const ImuSample& imu() const { return std::get<ImuSample>(message); }
  FeatureFrame& frame() { return std::get<StreamedFrame>(message).frame; }
};

class Stream {
 public:
  explicit Stream(FeatureDataset data) : data_(std::move(data)) {
    const TimeNs begin = data_.frames.front().stamp;
    std::size_t frame = 0;
    for (const ImuSample& sample : data_.imu) {
      for (; frame < data_.frames.size() && data_.frames[frame].stamp <= sample.stamp; ++frame)
        events_.push_back(
            {toSeconds(data_.frames[frame].stamp - begin), StreamedFrame{data_.frames[frame], frame}});
      events_.push_back({toSeconds(sample.stamp - begin), sample});
    }
  }

  const FeatureDataset& data() const { return data_; }
  std::vector<StreamEvent>& events() { return events_; }
  const std::vector<StreamEvent>& events() const { return events_; }

  void removeImu(double from, double to) {
    removeIf([&](const StreamEvent& e) { return e.isImu() && e.time > from && e.time < to; });
  }
  void removeImages(double from, double to) {
    removeIf([&](const StreamEvent& e) { return !e.isImu() && e.time > from && e.time < to; });
    renameTracksAfter(to);
  }
  /// Images without any tracked point.
  void darken(double from, double to) {
    for (StreamEvent& e : events_)
      if (!e.isImu() && e.time > from && e.time < to) e.frame().features.clear();
    renameTracksAfter(to);
  }
  /// The first image after `time` comes with a stamp that is late by `by` [s].
  void delayStamp(double time, double by) {
    if (StreamEvent* image = firstImageAfter(time)) image->frame().stamp += fromSeconds(by);
  }
  /// All points of the first image after `time` are elsewhere, as where the camera is knocked and stands the knock.
  void shiftImage(double time, const Eigen::Vector2d& pixels) {
    StreamEvent* image = firstImageAfter(time);
    if (!image) return;
    for (Feature& feature : image->frame().features) {
      feature.pixel += pixels;
      feature.normalized += feature.pixel_jacobian.inverse() * pixels;
    }
  }
  void shiftClock(double after, TimeNs shift) {
    for (StreamEvent& e : events_) {
      if (e.time <= after) continue;
      (e.isImu() ? e.imu().stamp : e.frame().stamp) += shift;
    }
    renameTracksAfter(after);
  }
  /// One more sample, changed by `change`, wherever an IMU sample stands in a place that `every` divides.
  void addImuAfterEach(std::size_t every, const std::function<void(ImuSample*)>& change) {
    std::vector<StreamEvent> more;
    for (StreamEvent& e : events_) {
      more.push_back(e);
      if (!e.isImu() || more.size() % every != 0) continue;
      more.push_back(e);
      change(&more.back().imu());
    }
    events_ = std::move(more);
  }

 private:
  StreamEvent* firstImageAfter(double time) {
    for (StreamEvent& e : events_)
      if (!e.isImu() && e.time > time) return &e;
    ADD_FAILURE() << "no image after " << time << " s";
    return nullptr;
  }
  void removeIf(const std::function<bool(const StreamEvent&)>& unwanted) {
    std::vector<StreamEvent> kept;
    for (StreamEvent& e : events_)
      if (!unwanted(e)) kept.push_back(std::move(e));
    events_ = std::move(kept);
  }
  // No tracker finds a point again after such a time.
  void renameTracksAfter(double time) {
    constexpr std::int64_t kOther = 1000000;
    for (StreamEvent& e : events_) {
      if (e.isImu() || e.time < time) continue;
      for (Feature& feature : e.frame().features) feature.track_id += kOther;
    }
  }

  FeatureDataset data_;
  std::vector<StreamEvent> events_;
};

/// An update, when it came (seconds after the first image, unaffected by shifted clocks), and the truth there.
struct FaultRecord {
  double time = 0.0;
  VioUpdate update;
  TruthSample truth;

  double sigmaPosition() const {
    return std::sqrt(update.odometry->covariance.topLeftCorner<3, 3>().trace());
  }
};

struct FaultRun {
  std::vector<FaultRecord> records;

  const FaultRecord& last() const { return records.back(); }
  /// The last record before `time`.
  const FaultRecord& before(double time) const {
    const FaultRecord* found = &records.front();
    for (const FaultRecord& r : records)
      if (r.time < time) found = &r;
    return *found;
  }
  /// The first record from `time` on that has (or has no) odometry; null where there is none.
  const FaultRecord* firstFrom(double time, bool with_odometry) const {
    for (const FaultRecord& r : records)
      if (r.time >= time && r.update.odometry.has_value() == with_odometry) return &r;
    return nullptr;
  }
  std::vector<FaultRecord> between(double from, double to) const {
    std::vector<FaultRecord> result;
    for (const FaultRecord& r : records)
      if (r.time > from && r.time < to) result.push_back(r);
    return result;
  }
};

/// Angle of the rotation about the vertical that brings a nearest to b [rad].
inline double headingDifference(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  const Eigen::Matrix3d R = (b * a.conjugate()).toRotationMatrix();
  return std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1));
}

/// Error of the position at `b` once position and heading agree at `a` [m].
inline double driftBetween(const FaultRecord& a, const FaultRecord& b) {
  const Transform &estimate_a = a.update.odometry->T_odom_imu, &estimate_b = b.update.odometry->T_odom_imu;
  const double yaw = headingDifference(estimate_a.rotation, a.truth.T_WB.rotation);
  const Eigen::Vector3d step =
      Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * (estimate_b.translation - estimate_a.translation);
  return (step - (b.truth.T_WB.translation - a.truth.T_WB.translation)).norm();
}

inline double rotationErrorDeg(const VioUpdate& update, const FeatureDataset& data) {
  return data.rig.T_imu_cam.rotation.angularDistance(update.calibration.T_imu_cam.rotation) / kDegree;
}

inline double translationError(const VioUpdate& update, const FeatureDataset& data) {
  return (update.calibration.T_imu_cam.translation - data.rig.T_imu_cam.translation).norm();
}

/// Same bits.
inline bool identical(const Transform& a, const Transform& b) {
  return (a.rotation.coeffs().array() == b.rotation.coeffs().array()).all() &&
         (a.translation.array() == b.translation.array()).all();
}

/// True when every number of an update is finite.
inline bool isFinite(const VioUpdate& update) {
  const CalibrationEstimate& c = update.calibration;
  bool finite =
      c.T_imu_cam.isFinite() && c.covariance.allFinite() && std::isfinite(c.td) &&
      std::isfinite(c.sigma_td) && c.gyroscope_bias.allFinite() && c.sigma_gyroscope_bias.allFinite() &&
      c.accelerometer_bias.allFinite() && c.sigma_accelerometer_bias.allFinite() && std::isfinite(c.scale) &&
      std::isfinite(c.sigma_scale) && c.gravity.allFinite() && std::isfinite(c.sigma_gravity_direction) &&
      c.singular_values.allFinite() && std::isfinite(c.accelerometer_noise_factor) &&
      std::isfinite(c.gyroscope_noise_factor) && std::isfinite(c.pixel_sigma);
  if (update.odometry) {
    const OdometryEstimate& o = *update.odometry;
    finite = finite && o.T_odom_imu.isFinite() && o.velocity_W.allFinite() &&
             o.angular_velocity_B.allFinite() && o.covariance.allFinite() &&
             o.angular_velocity_covariance_B.allFinite();
  }
  for (const Eigen::Vector3d& landmark : update.landmarks_W) finite = finite && landmark.allFinite();
  return finite;
}

/// Feeds the whole stream. `at` (optional) is called before each message with its time.
inline FaultRun runStream(const Stream& stream, const RigModel& rig, const VioOptions& options,
                          const std::function<void(double, VioSystem*)>& at = nullptr) {
  FaultRun run;
  std::deque<std::pair<TimeNs, StreamEvent>> sent;  // images not answered yet
  const auto sink = [&](const VioUpdate& update) {
    while (!sent.empty() && sent.front().first != update.stamp) sent.pop_front();
    ASSERT_FALSE(sent.empty()) << "an update without an image";
    const StreamEvent& event = sent.front().second;
    run.records.push_back(
        {event.time, update, stream.data().truth[std::get<StreamedFrame>(event.message).index]});
    EXPECT_TRUE(isFinite(update)) << "at " << event.time << " s: " << toString(update.state) << ", "
                                  << update.reason;
    EXPECT_FALSE(update.reason.empty()) << "at " << event.time << " s: " << toString(update.state);
  };
  VioSystem system(rig, options, sink);
  for (const StreamEvent& event : stream.events()) {
    if (at) at(event.time, &system);
    if (event.isImu()) {
      system.addImu(event.imu());
    } else {
      const FeatureFrame& frame = std::get<StreamedFrame>(event.message).frame;
      sent.emplace_back(frame.stamp, event);
      system.addFeatures(frame);
    }
  }
  return run;
}

/// Prints where the state changes, for the log.
inline void printStates(const FaultRun& run) {
  const FaultRecord* before = nullptr;
  for (const FaultRecord& r : run.records) {
    if (!before || before->update.state != r.update.state)
      std::printf("  %6.2f s %-23s %s\n", r.time, toString(r.update.state), r.update.reason.c_str());
    before = &r;
  }
  std::fflush(stdout);
}

/// A stream of `seconds` of free motion with EuRoC's noise.
inline Stream eurocStream(std::uint64_t seed, double seconds) {
  FeatureSimulationOptions simulation = FeatureSimulationOptions::euroc(seed);
  simulation.motion.duration = seconds;
  return Stream(simulateFeatures(simulation));
}

/// The rig with the true extrinsics as a prior, so that estimation starts early.
inline RigModel calibratedRig(const FeatureDataset& data) {
  RigModel rig = data.rig.rig;
  rig.extrinsics_prior = ExtrinsicsPrior{data.rig.T_imu_cam, 0.5 * kDegree, 0.01};
  return rig;
}

/// The extrinsics at the end [deg, m].
inline void expectCalibrated(const FaultRun& run, const FeatureDataset& data, double rotation_deg,
                             double translation) {
  EXPECT_LT(rotationErrorDeg(run.last().update, data), rotation_deg);
  EXPECT_LT(translationError(run.last().update, data), translation);
}

/// Lost once after `fault`, found again by itself within `longest_recovery` of the time when good data came back, with
/// the calibration kept and without a jump [s].
inline void expectRecovery(const FaultRun& run, const FeatureDataset& data, double fault,
                           double return_of_data, double longest_recovery) {
  const FaultRecord& before = run.before(fault);
  ASSERT_TRUE(before.update.odometry);
  const FaultRecord* lost = run.firstFrom(fault, false);
  ASSERT_TRUE(lost);
  EXPECT_EQ(lost->update.state, VioState::kLost);
  const FaultRecord* found = run.firstFrom(lost->time, true);
  ASSERT_TRUE(found);
  EXPECT_GT(found->time, return_of_data);
  EXPECT_LT(found->time - return_of_data, longest_recovery);
  for (const FaultRecord& r : run.between(lost->time - 1e-6, found->time - 1e-6))
    EXPECT_EQ(r.update.state, VioState::kLost) << r.time;

  // The calibration is what it was, and is all the next start has.
  const FaultRecord& last_pose = run.before(lost->time);
  EXPECT_TRUE(identical(lost->update.calibration.T_imu_cam, last_pose.update.calibration.T_imu_cam));
  const std::vector<FaultRecord> next = run.between(lost->time, lost->time + 0.12);
  ASSERT_FALSE(next.empty());
  EXPECT_TRUE(identical(next.front().update.calibration.T_imu_cam, last_pose.update.calibration.T_imu_cam));
  EXPECT_EQ(next.front().update.calibration.td, last_pose.update.calibration.td);

  const Transform &end = last_pose.update.odometry->T_odom_imu, &start = found->update.odometry->T_odom_imu;
  EXPECT_LT((start.translation - end.translation).norm(), 1e-6) << "a jump";
  EXPECT_LT(std::abs(headingDifference(start.rotation, end.rotation)), 1e-6) << "another heading";
  EXPECT_FALSE(run.firstFrom(found->time, false)) << "lost again";
  EXPECT_EQ(run.last().update.counters.resets, 1U);
  expectCalibrated(run, data, 0.3, 0.02);
  EXPECT_LT(driftBetween(*found, run.last()), 0.15);
  std::printf(
      "  recovered %.2f s after the data came back, at the end %.3f deg, %.1f mm, drift since %.3f m\n",
      found->time - return_of_data, rotationErrorDeg(run.last().update, data),
      1e3 * translationError(run.last().update, data), driftBetween(*found, run.last()));
}

}  // namespace autocal_vio
