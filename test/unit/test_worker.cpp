#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <mutex>
#include <stdexcept>
#include <vector>

#include "autocal_vio/pipeline/worker.h"

namespace autocal_vio {
namespace {

using std::chrono::milliseconds;

RigModel smallRig() {
  RigModel rig;
  CameraIntrinsics camera;
  camera.intrinsics << 100.0, 100.0, 80.0, 60.0;
  camera.width = 160;
  camera.height = 120;
  rig.camera = camera;
  return rig;
}

ImuSample restingAt(TimeNs stamp) {
  ImuSample sample;
  sample.stamp = stamp;
  sample.acceleration.z() = 9.81;
  return sample;
}

ImageFrame greyAt(TimeNs stamp, int width = 160) {
  return {stamp, cv::Mat(120, width, CV_8UC1, cv::Scalar(90))};
}

/// One second of data at rest: 200 Hz and 20 Hz.
void feedOneSecond(Worker* worker, TimeNs start) {
  for (int i = 0; i <= 200; ++i) {
    worker->add(restingAt(start + i * 5000000));
    if (i % 10 == 5) worker->add(greyAt(start + i * 5000000 - 1000000));
  }
}

void waitUntilIdle(Worker* worker) {
  ASSERT_TRUE(worker->run([](VioSystem&) {}, milliseconds(20000)).done);
}

PacketQueueOptions roomyQueue() {
  PacketQueueOptions options;
  options.max_images = 1000;
  return options;
}

TEST(Worker, ProcessesEveryImageInItsOwnThread) {
  std::vector<TimeNs> stamps;
  std::thread::id thread;
  WorkerCallbacks callbacks;
  callbacks.on_update = [&](const VioUpdate& update) {
    stamps.push_back(update.stamp);
    thread = std::this_thread::get_id();
  };
  Worker worker(smallRig(), VioOptions(), roomyQueue(), callbacks);
  feedOneSecond(&worker, kNsPerSecond);
  waitUntilIdle(&worker);
  ASSERT_EQ(stamps.size(), 20u);
  for (std::size_t i = 1; i < stamps.size(); ++i) EXPECT_EQ(stamps[i] - stamps[i - 1], 50000000);
  EXPECT_NE(thread, std::this_thread::get_id());
}

TEST(Worker, ReportsRefusedImages) {
  std::vector<std::string> problems;
  WorkerCallbacks callbacks;
  callbacks.on_refused = [&](TimeNs, const std::string& problem) { problems.push_back(problem); };
  Worker worker(smallRig(), VioOptions(), roomyQueue(), callbacks);
  worker.add(greyAt(kNsPerSecond, 200));
  waitUntilIdle(&worker);
  ASSERT_EQ(problems.size(), 1u);
  EXPECT_NE(problems[0].find("160x120"), std::string::npos) << problems[0];
}

TEST(Worker, CommandsAnswerTheirCaller) {
  Worker worker(smallRig(), VioOptions(), roomyQueue(), {});
  auto width = std::make_shared<std::atomic<int>>(0);
  EXPECT_TRUE(
      worker.run([width](VioSystem& system) { *width = system.camera().width(); }, milliseconds(5000)).done);
  EXPECT_EQ(*width, 160);
  const CommandResult failed =
      worker.run([](VioSystem&) { throw std::runtime_error("disk full"); }, milliseconds(5000));
  EXPECT_FALSE(failed.done);
  EXPECT_EQ(failed.problem, "disk full");
}

TEST(Worker, ACommandThatIsLateSaysSo) {
  Worker worker(smallRig(), VioOptions(), roomyQueue(), {});
  std::promise<void> release;
  auto released = std::make_shared<std::shared_future<void>>(release.get_future().share());
  const CommandResult late = worker.run([released](VioSystem&) { released->wait(); }, milliseconds(20));
  EXPECT_FALSE(late.done);
  EXPECT_NE(late.problem.find("20 ms"), std::string::npos) << late.problem;
  release.set_value();
  waitUntilIdle(&worker);
}

TEST(Worker, AnExceptionBecomesLostAndProcessingGoesOn) {
  int updates = 0, lost = 0, after = 0;
  std::vector<std::string> failures;
  WorkerCallbacks callbacks;
  callbacks.on_update = [&](const VioUpdate& update) {
    ++updates;
    if (updates == 5) throw std::runtime_error("five");
    if (update.state == VioState::kLost && update.reason.find("five") != std::string::npos) {
      ++lost;
      EXPECT_FALSE(update.odometry.has_value());
    } else if (lost > 0) {
      ++after;
    }
  };
  callbacks.on_failure = [&](const std::string& what) { failures.push_back(what); };
  Worker worker(smallRig(), VioOptions(), roomyQueue(), callbacks);
  feedOneSecond(&worker, kNsPerSecond);
  waitUntilIdle(&worker);
  EXPECT_EQ(failures, std::vector<std::string>{"five"});
  EXPECT_EQ(lost, 1);
  EXPECT_GE(after, 14);
}

TEST(Worker, DiscardAndResetAcceptsAnEarlierClock) {
  std::vector<TimeNs> stamps;
  WorkerCallbacks callbacks;
  callbacks.on_update = [&](const VioUpdate& update) { stamps.push_back(update.stamp); };
  Worker worker(smallRig(), VioOptions(), roomyQueue(), callbacks);
  feedOneSecond(&worker, 100 * kNsPerSecond);
  waitUntilIdle(&worker);
  const std::size_t before = stamps.size();
  worker.discardAndReset(true);
  feedOneSecond(&worker, kNsPerSecond);
  waitUntilIdle(&worker);
  EXPECT_EQ(before, 20u);
  EXPECT_EQ(stamps.size(), 40u);
  EXPECT_LT(stamps.back(), 3 * kNsPerSecond);
}

TEST(Worker, RefusesABadRigAtOnce) {
  RigModel rig;
  EXPECT_THROW(Worker(rig, VioOptions(), PacketQueueOptions(), {}), std::invalid_argument);
}

TEST(Worker, EndsWhileDataPoursIn) {
  for (int round = 0; round < 5; ++round) {
    auto worker = std::make_unique<Worker>(smallRig(), VioOptions(), PacketQueueOptions(), WorkerCallbacks());
    std::thread imu([&] {
      for (int i = 0; i < 400; ++i) worker->add(restingAt(i * 5000000));
    });
    std::thread camera([&] {
      for (int i = 0; i < 40; ++i) worker->add(greyAt(i * 50000000));
    });
    imu.join();
    camera.join();
    worker.reset();
  }
}

}  // namespace
}  // namespace autocal_vio
