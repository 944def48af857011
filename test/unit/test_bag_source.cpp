#include "autocal_vio/tools/bag_source.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <vector>

#include "autocal_vio/ros/input_conversions.h"
#include "autocal_vio/ros/sensor_messages.h"
#include "temporary_folder.h"

namespace autocal_vio {
namespace {

constexpr TimeNs kBegin = 1000 * kNsPerSecond;
constexpr int kImages = 60;

/// 60 images at 20 Hz with ten IMU samples each, in chunks of a few images.
std::string writeBag(const TemporaryFolder& folder, rosbag::CompressionType compression) {
  const std::string path = folder.path("data.bag");
  rosbag::Bag bag(path, rosbag::bagmode::Write);
  bag.setCompression(compression);
  bag.setChunkThreshold(20000);
  cv::Mat picture(60, 80, CV_8UC1);
  cv::RNG(1).fill(picture, cv::RNG::UNIFORM, 0, 255);
  for (int i = 0; i < 10 * kImages; ++i) {
    ImuSample sample;
    sample.stamp = kBegin + i * TimeNs{5000000};
    bag.write("/imu", toRosTime(sample.stamp), toImuMessage(sample, ImuNoise(), "imu"));
    if (i % 10 == 0)
      bag.write("/image", toRosTime(sample.stamp), toImageMessage(sample.stamp, picture, "cam"));
  }
  bag.close();
  return path;
}

/// Overwrites what follows, `distance` bytes on, the `number`th place where `text` stands.
void damageAfter(const std::string& path, const std::string& text, int number, std::size_t distance,
                 const std::string& replacement) {
  std::string bytes = readWholeFile(path);
  std::size_t place = 0;
  for (int i = 0; i < number; ++i) place = bytes.find(text, place + 1);
  ASSERT_NE(place, std::string::npos);
  bytes.replace(place + text.size() + distance, replacement.size(), replacement);
  std::ofstream(path, std::ios::binary) << bytes;
}

struct Read {
  int images = 0, imu = 0;
  TimeNs last_image = 0, last_imu = 0;
  std::vector<std::string> warnings;
  std::optional<std::string> damage;
};

Read readAll(const std::string& path) {
  Read read;
  BagSource source(path, {}, [&read](const std::string& text) { read.warnings.push_back(text); });
  for (; source.imuStamp(); ++read.imu) read.last_imu = source.takeImu().stamp;
  for (; source.imageStamp(); ++read.images) {
    read.last_image = *source.imageStamp();
    EXPECT_TRUE(source.takeImage());
  }
  read.damage = source.damage();
  return read;
}

void expectEndedEarly(const Read& read) {
  EXPECT_GT(read.images, 5);
  EXPECT_LT(read.images, kImages - 5);
  EXPECT_GT(read.imu, 50);
  EXPECT_LT(read.imu, 10 * kImages - 50);
  ASSERT_TRUE(read.damage);
  ASSERT_EQ(read.warnings.size(), 2u);
  EXPECT_NE(read.warnings[0].find("data.bag: /imu: cannot be read after the message of 100"),
            std::string::npos)
      << read.warnings[0];
  EXPECT_NE(read.warnings[1].find("data.bag: /image: cannot be read after the message of 100"),
            std::string::npos)
      << read.warnings[1];
  EXPECT_NE(read.damage->find("/imu"), std::string::npos);
  EXPECT_NE(read.damage->find("/image"), std::string::npos);
}

TEST(BagSource, ReadsBothStreams) {
  const TemporaryFolder folder;
  for (const auto compression :
       {rosbag::compression::Uncompressed, rosbag::compression::BZ2, rosbag::compression::LZ4}) {
    const Read read = readAll(writeBag(folder, compression));
    EXPECT_EQ(read.images, kImages);
    EXPECT_EQ(read.imu, 10 * kImages);
    EXPECT_FALSE(read.damage);
    EXPECT_TRUE(read.warnings.empty());
  }
}

TEST(BagSource, EndsWhereAChunkCannotBeDecompressed) {
  const TemporaryFolder folder;
  for (const auto compression : {rosbag::compression::BZ2, rosbag::compression::LZ4}) {
    const std::string path = writeBag(folder, compression);
    damageAfter(path, compression == rosbag::compression::BZ2 ? "compression=bz2" : "compression=lz4", 6, 500,
                std::string(1500, '\x5a'));
    expectEndedEarly(readAll(path));
  }
}

TEST(BagSource, EndsWhereAChunkHasNoHeader) {
  const TemporaryFolder folder;
  const std::string path = writeBag(folder, rosbag::compression::Uncompressed);
  damageAfter(path, "compression=", 6, 0, "what");
  expectEndedEarly(readAll(path));
}

// The bytes of one message on one topic: the other topic goes on.
TEST(BagSource, ADamagedTopicLeavesTheOtherOne) {
  const TemporaryFolder folder;
  const std::string path = writeBag(folder, rosbag::compression::Uncompressed);
  damageAfter(path, "mono8", 20, 0,
              std::string(8, '\x7f'));  // is_bigendian, step, and most of the size of the data
  const Read read = readAll(path);
  EXPECT_EQ(read.imu, 10 * kImages);
  EXPECT_EQ(read.images, 19);
  ASSERT_TRUE(read.damage);
  EXPECT_NE(read.damage->find("data.bag: /image: cannot be read after the message of 1000.900000000 s"),
            std::string::npos)
      << *read.damage;
}

}  // namespace
}  // namespace autocal_vio
