// Data that are wrong for the first seconds, but plausible: what is found from them is wrong. It must be found out and
// left behind without any help once the data are right, and nothing wrong be called converged.
#include "fault_run.h"

namespace autocal_vio {
namespace {

constexpr double kWrongUntil = 5.0, kEnd = 25.0;  // [s]

FaultRun runWithWrongBeginning(const Stream& right, const std::function<void(ImuSample*)>& change) {
  Stream stream = right;
  for (StreamEvent& event : stream.events())
    if (event.isImu() && event.time < kWrongUntil) change(&event.imu());
  FaultRun run = runStream(stream, stream.data().rig.rig, VioOptions());
  printStates(run);
  return run;
}

void expectRightInTheEnd(const FaultRun& run, const FeatureDataset& data) {
  const FaultRecord* first = run.firstFrom(0.0, true);
  ASSERT_TRUE(first);
  EXPECT_GT(first->time, kWrongUntil) << "odometry from data that were wrong";
  EXPECT_LT(first->time, kWrongUntil + 8.0);
  for (const FaultRecord& record : run.records) {
    if (record.update.state != VioState::kConverged) continue;
    EXPECT_LT(rotationErrorDeg(record.update, data), 0.3) << record.time;
    EXPECT_LT(translationError(record.update, data), 0.02) << record.time;
  }
  const VioUpdate& last = run.last().update;
  EXPECT_LT(rotationErrorDeg(last, data), 0.3);
  EXPECT_LT(translationError(last, data), 0.05);
  std::printf("  first odometry at %.2f s, at the end %.3f deg, %.1f mm\n", first->time,
              rotationErrorDeg(last, data), 1e3 * translationError(last, data));
}

TEST(WrongBeginning, AGyroscopeTooFast) {
  const Stream right = eurocStream(2, kEnd);
  const FaultRun run = runWithWrongBeginning(right, [](ImuSample* s) { s->angular_velocity *= 1.2; });
  expectRightInTheEnd(run, right.data());
}

TEST(WrongBeginning, AnAccelerometerTurned) {
  const Stream right = eurocStream(2, kEnd);
  const Eigen::AngleAxisd turn(0.35, Eigen::Vector3d(1, 1, 0).normalized());
  const FaultRun run =
      runWithWrongBeginning(right, [&](ImuSample* s) { s->acceleration = turn * s->acceleration; });
  expectRightInTheEnd(run, right.data());
}

// Ten percent too much fits well enough for the odometry to begin with it: then the data contradict it later, and all that was
// found from it goes.
TEST(WrongBeginning, AnAccelerometerTooStrong) {
  for (const std::uint64_t seed : {2, 4}) {
    const Stream right = eurocStream(seed, kEnd);
    const FaultRun run = runWithWrongBeginning(right, [](ImuSample* s) { s->acceleration *= 1.1; });
    const FaultRecord* first = run.firstFrom(0.0, true);
    ASSERT_TRUE(first);
    EXPECT_LT(first->time, kWrongUntil) << "nothing to be found out";
    for (const FaultRecord& record : run.records) {
      if (record.update.state != VioState::kConverged) continue;
      EXPECT_LT(rotationErrorDeg(record.update, right.data()), 0.3) << record.time;
      EXPECT_LT(translationError(record.update, right.data()), 0.02) << record.time;
    }
    EXPECT_EQ(run.last().update.state, VioState::kConverged) << run.last().update.reason;
    std::printf("  seed %d: at the end %.3f deg, %.1f mm\n", static_cast<int>(seed),
                rotationErrorDeg(run.last().update, right.data()),
                1e3 * translationError(run.last().update, right.data()));
  }
}

// The gyroscope alone fits a camera that is turned: that rotation is accepted. No odometry begins with it.
TEST(WrongBeginning, AGyroscopeTurned) {
  const Stream right = eurocStream(2, kEnd);
  const Eigen::AngleAxisd turn(0.35, Eigen::Vector3d(1, 1, 0).normalized());
  const FaultRun run =
      runWithWrongBeginning(right, [&](ImuSample* s) { s->angular_velocity = turn * s->angular_velocity; });
  expectRightInTheEnd(run, right.data());
  const FaultRecord& wrong = run.before(kWrongUntil);
  EXPECT_EQ(wrong.update.state, VioState::kCalibratingTranslation);
  EXPECT_GT(rotationErrorDeg(wrong.update, right.data()), 5.0);
  for (const FaultRecord& record : run.records)
    EXPECT_TRUE(!record.update.odometry || rotationErrorDeg(record.update, right.data()) < 1.0)
        << record.time;
}

}  // namespace
}  // namespace autocal_vio
