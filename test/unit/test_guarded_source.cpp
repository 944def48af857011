#include "autocal_vio/tools/guarded_source.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "autocal_vio/tools/dataset_reader.h"

namespace autocal_vio {
namespace {

constexpr TimeNs kBegin = 1000000 * kNsPerSecond;
constexpr TimeNs kHour = 3600 * kNsPerSecond;
constexpr TimeNs kImuStep = 5000000, kImageStep = 50000000;

using Stamps = std::vector<TimeNs>;

/// Nothing but stamps.
class ListSource : public SensorSource {
 public:
  ListSource(Stamps imu, Stamps images) : imu_(std::move(imu)), images_(std::move(images)) {}

  std::optional<TimeNs> imuStamp() override { return at(imu_, next_imu_); }
  ImuSample takeImu() override {
    ImuSample sample;
    sample.stamp = imu_[next_imu_++];
    return sample;
  }
  std::optional<TimeNs> imageStamp() override { return at(images_, next_image_); }
  std::optional<ImageFrame> takeImage() override { return ImageFrame{images_[next_image_++], cv::Mat()}; }
  void skipImage() override { ++next_image_; }
  std::size_t imageCount() const override { return images_.size(); }
  std::size_t badImu() const override { return 0; }
  std::size_t badImages() const override { return 0; }
  std::string description() const override { return "a list"; }

 private:
  static std::optional<TimeNs> at(const Stamps& stamps, std::size_t i) {
    if (i >= stamps.size()) return std::nullopt;
    return stamps[i];
  }

  Stamps imu_, images_;
  std::size_t next_imu_ = 0, next_image_ = 0;
};

Stamps regular(TimeNs step) {
  Stamps stamps;
  for (TimeNs t = 0; t <= 4 * kNsPerSecond; t += step) stamps.push_back(kBegin + t);
  return stamps;
}

struct Read {
  Stamps imu, images;
  std::vector<std::string> warnings;
  std::size_t bad_imu = 0, bad_images = 0;
};

Read readAll(const Stamps& imu, const Stamps& images) {
  Read read;
  auto guarded =
      std::make_unique<GuardedSource>(std::make_unique<ListSource>(imu, images), "data",
                                      [&read](const std::string& text) { read.warnings.push_back(text); });
  DatasetReader reader(std::move(guarded), {});
  while (const std::optional<DatasetItem> item = reader.next()) {
    if (const ImuSample* sample = std::get_if<ImuSample>(&*item)) {
      read.imu.push_back(sample->stamp);
    } else {
      read.images.push_back(std::get<ImageFrame>(*item).stamp);
    }
  }
  read.bad_imu = reader.source().badImu();
  read.bad_images = reader.source().badImages();
  return read;
}

Stamps without(Stamps stamps, std::size_t index) {
  stamps.erase(stamps.begin() + static_cast<std::ptrdiff_t>(index));
  return stamps;
}

TEST(GuardedSource, LetsGoodDataThrough) {
  const Read read = readAll(regular(kImuStep), regular(kImageStep));
  EXPECT_EQ(read.imu, regular(kImuStep));
  EXPECT_EQ(read.images, regular(kImageStep));
  EXPECT_TRUE(read.warnings.empty());
}

TEST(GuardedSource, OneWildStampCostsThatEntryOnly) {
  const Stamps imu = regular(kImuStep), images = regular(kImageStep);
  for (const TimeNs error : {kHour, -kHour}) {
    for (const double place : {0.0, 0.5, 1.0}) {
      if (place == 0.0 && error < 0) continue;  // the next test
      SCOPED_TRACE(::testing::Message() << "at " << place << ", off by " << toSeconds(error) << " s");
      const std::size_t i = static_cast<std::size_t>(place * static_cast<double>(imu.size() - 1));
      Stamps wild = imu;
      wild[i] += error;
      Read read = readAll(wild, images);
      EXPECT_EQ(read.imu, without(imu, i));
      EXPECT_EQ(read.images, images);
      EXPECT_EQ(read.bad_imu, 1u);
      ASSERT_EQ(read.warnings.size(), 1u);
      EXPECT_EQ(read.warnings[0].find("data: IMU sample at " + std::to_string(wild[i] / kNsPerSecond) + "."),
                0u)
          << read.warnings[0];

      const std::size_t k = static_cast<std::size_t>(place * static_cast<double>(images.size() - 1));
      wild = images;
      wild[k] += error;
      read = readAll(imu, wild);
      EXPECT_EQ(read.imu, imu);
      EXPECT_EQ(read.images, without(images, k));
      EXPECT_EQ(read.bad_images, 1u);
      ASSERT_EQ(read.warnings.size(), 1u);
      EXPECT_EQ(read.warnings[0].find("data: image at "), 0u) << read.warnings[0];
    }
  }
}

// The guard asks for three stamps that agree before it believes that the first one was behind.
// Whatever it is that is wrong, what follows is not; MeasurementSync and ImuGlitchFilter leave out the one that was ahead.
TEST(GuardedSource, WhatFollowsAStampALittleAheadIsRead) {
  Stamps imu = regular(kImuStep), images = regular(kImageStep);
  images[40] += kNsPerSecond / 5;
  imu[300] += kNsPerSecond / 50;
  const Read read = readAll(imu, images);
  EXPECT_EQ(read.images, images);
  EXPECT_EQ(read.imu, imu);
  EXPECT_EQ(read.bad_images + read.bad_imu, 0u);
  ASSERT_EQ(read.warnings.size(), 2u);
  for (const std::string& warning : read.warnings)
    EXPECT_NE(warning.find("behind the one before, which was ahead"), std::string::npos) << warning;
}

TEST(GuardedSource, AFirstStampBehindCostsTwoMore) {
  const Stamps imu = regular(kImuStep), images = regular(kImageStep);
  Stamps wild = imu;
  wild[0] -= kHour;
  EXPECT_EQ(readAll(wild, images).imu, Stamps(imu.begin() + 3, imu.end()));
  wild = images;
  wild[0] -= kHour;
  const Read read = readAll(imu, wild);
  EXPECT_EQ(read.imu, imu);
  EXPECT_EQ(Stamps(read.images.begin() + 1, read.images.end()), Stamps(images.begin() + 3, images.end()));
}

TEST(GuardedSource, DuplicatesAndDisorderAreSkipped) {
  Stamps imu = regular(kImuStep);
  imu[100] = imu[99];
  imu[200] = imu[190] + 1;
  const Read read = readAll(imu, regular(kImageStep));
  EXPECT_EQ(read.imu, without(without(regular(kImuStep), 200), 100));
  EXPECT_EQ(read.bad_imu, 2u);
  EXPECT_EQ(read.images, regular(kImageStep));
}

TEST(GuardedSource, AClockThatGoesBackForGoodIsFollowed) {
  Stamps images = regular(kImageStep);
  for (std::size_t i = 40; i < images.size(); ++i) images[i] -= 1000 * kNsPerSecond;
  const Read read = readAll(regular(kImuStep), images);
  EXPECT_EQ(read.images.size(), images.size() - 2);
  EXPECT_EQ(read.images.back(), images.back());
  ASSERT_EQ(read.warnings.size(), 3u);
  EXPECT_NE(read.warnings[2].find("goes back by"), std::string::npos) << read.warnings[2];
}

TEST(GuardedSource, ImagesCanBePassedOver) {
  GuardedSource source(std::make_unique<ListSource>(regular(kImuStep), regular(kImageStep)), "data",
                       [](const std::string&) {});
  source.skipImage();
  source.skipImage();
  EXPECT_EQ(*source.imageStamp(), kBegin + 2 * kImageStep);
  EXPECT_EQ(source.takeImage()->stamp, kBegin + 2 * kImageStep);
  EXPECT_EQ(source.takeImage()->stamp, kBegin + 3 * kImageStep);
}

TEST(GuardedSource, EmptyStreamsStayEmpty) {
  GuardedSource source(std::make_unique<ListSource>(Stamps{}, Stamps{}), "data", [](const std::string&) {});
  EXPECT_FALSE(source.imuStamp());
  EXPECT_FALSE(source.imageStamp());
}

}  // namespace
}  // namespace autocal_vio
