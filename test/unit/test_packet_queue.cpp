#include <gtest/gtest.h>

#include <atomic>
#include <limits>
#include <stdexcept>
#include <thread>

#include "autocal_vio/pipeline/packet_queue.h"

namespace autocal_vio {
namespace {

ImuSample imuAt(TimeNs stamp) {
  ImuSample sample;
  sample.stamp = stamp;
  return sample;
}

ImageFrame imageAt(TimeNs stamp) {
  return {stamp, cv::Mat()};
}

TEST(PacketQueue, KeepsTheOrderAcrossKinds) {
  PacketQueue queue;
  bool ran = false;
  queue.push(imuAt(1));
  queue.push(imageAt(2));
  queue.push(Command([&ran](VioSystem&) { ran = true; }));
  queue.push(imuAt(3));
  EXPECT_EQ(std::get<ImuSample>(*queue.pop()).stamp, 1);
  EXPECT_EQ(std::get<ImageFrame>(*queue.pop()).stamp, 2);
  EXPECT_TRUE(std::holds_alternative<Command>(*queue.pop()));
  EXPECT_EQ(std::get<ImuSample>(*queue.pop()).stamp, 3);
  EXPECT_FALSE(ran);
}

TEST(PacketQueue, DropsTheOldestImageAndNothingElse) {
  PacketQueueOptions options;
  options.max_images = 2;
  PacketQueue queue(options);
  queue.push(imuAt(1));
  for (TimeNs stamp = 10; stamp < 15; ++stamp) queue.push(imageAt(stamp));
  queue.push(imuAt(2));
  EXPECT_EQ(queue.counters().images_dropped, 3u);
  EXPECT_EQ(queue.counters().imu_dropped, 0u);
  EXPECT_EQ(queue.counters().images_waiting, 2u);
  EXPECT_EQ(queue.counters().imu_waiting, 2u);
  EXPECT_EQ(std::get<ImuSample>(*queue.pop()).stamp, 1);
  EXPECT_EQ(std::get<ImageFrame>(*queue.pop()).stamp, 13);
  EXPECT_EQ(std::get<ImageFrame>(*queue.pop()).stamp, 14);
  EXPECT_EQ(std::get<ImuSample>(*queue.pop()).stamp, 2);
  EXPECT_EQ(queue.counters().images_waiting, 0u);
  EXPECT_EQ(queue.counters().imu_waiting, 0u);
}

TEST(PacketQueue, BoundsImuByCount) {
  PacketQueueOptions options;
  options.max_imu_samples = 10;
  PacketQueue queue(options);
  for (TimeNs stamp = 1; stamp <= 25; ++stamp) queue.push(imuAt(stamp));
  EXPECT_EQ(queue.counters().imu_waiting, 10u);
  EXPECT_EQ(queue.counters().imu_dropped, 15u);
  EXPECT_EQ(std::get<ImuSample>(*queue.pop()).stamp, 16);
}

TEST(PacketQueue, BoundsImuByTime) {
  PacketQueueOptions options;
  options.max_imu_span = kNsPerSecond;
  PacketQueue queue(options);
  for (int i = 0; i <= 30; ++i) queue.push(imuAt(i * kNsPerSecond / 10));
  EXPECT_EQ(queue.counters().imu_waiting, 11u);
  EXPECT_EQ(queue.counters().imu_dropped, 20u);
  EXPECT_EQ(std::get<ImuSample>(*queue.pop()).stamp, 2 * kNsPerSecond);
}

TEST(PacketQueue, RefusesCommandsBeyondItsLimit) {
  PacketQueueOptions options;
  options.max_commands = 2;
  PacketQueue queue(options);
  const Command nothing = [](VioSystem&) {};
  EXPECT_TRUE(queue.push(nothing));
  EXPECT_TRUE(queue.push(nothing));
  EXPECT_FALSE(queue.push(nothing));
  queue.pop();
  EXPECT_TRUE(queue.push(nothing));
}

TEST(PacketQueue, ClearDataKeepsCommandsAndCountsNothing) {
  PacketQueue queue;
  queue.push(imuAt(1));
  queue.push(Command([](VioSystem&) {}));
  queue.push(imageAt(2));
  queue.clearData();
  EXPECT_EQ(queue.counters().images_waiting, 0u);
  EXPECT_EQ(queue.counters().imu_waiting, 0u);
  EXPECT_EQ(queue.counters().images_dropped, 0u);
  queue.push(imageAt(3));
  EXPECT_TRUE(std::holds_alternative<Command>(*queue.pop()));
  EXPECT_EQ(std::get<ImageFrame>(*queue.pop()).stamp, 3);
}

TEST(PacketQueue, CloseEndsAWaitingPop) {
  PacketQueue queue;
  std::atomic<bool> ended{false};
  std::thread consumer([&] {
    EXPECT_FALSE(queue.pop().has_value());
    ended = true;
  });
  queue.close();
  consumer.join();
  EXPECT_TRUE(ended);
  EXPECT_FALSE(queue.push(imuAt(1)));
}

TEST(PacketQueue, RefusesOptionsOutOfBounds) {
  PacketQueueOptions options;
  options.max_images = 0;
  options.max_imu_span = 0;
  try {
    const PacketQueue queue(options);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("max_images"), std::string::npos) << text;
    EXPECT_NE(text.find("max_imu_span"), std::string::npos) << text;
  }
}

TEST(PacketQueue, LosesNothingUncountedBetweenThreads) {
  PacketQueueOptions options;
  options.max_images = 3;
  PacketQueue queue(options);
  constexpr int kImages = 2000, kSamples = 20000;
  int images = 0, samples = 0;
  TimeNs last_image = -1, last_sample = -1;
  bool in_order = true;
  std::thread consumer([&] {
    while (std::optional<Packet> packet = queue.pop()) {
      if (const ImageFrame* frame = std::get_if<ImageFrame>(&*packet)) {
        ++images;
        in_order = in_order && frame->stamp > last_image;
        last_image = frame->stamp;
        if (frame->stamp == kImages - 1) break;
      } else {
        ++samples;
        const TimeNs stamp = std::get<ImuSample>(*packet).stamp;
        in_order = in_order && stamp > last_sample;
        last_sample = stamp;
      }
    }
  });
  std::thread imu([&] {
    for (int i = 0; i < kSamples; ++i) queue.push(imuAt(i));
  });
  imu.join();
  std::thread camera([&] {
    for (int i = 0; i < kImages; ++i) queue.push(imageAt(i));
  });
  camera.join();
  consumer.join();
  const PacketQueue::Counters counters = queue.counters();
  EXPECT_TRUE(in_order);
  EXPECT_EQ(images + static_cast<int>(counters.images_dropped + counters.images_waiting), kImages);
  EXPECT_EQ(samples + static_cast<int>(counters.imu_dropped + counters.imu_waiting), kSamples);
}

}  // namespace
}  // namespace autocal_vio
