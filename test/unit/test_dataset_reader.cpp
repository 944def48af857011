#include "autocal_vio/tools/dataset_reader.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "asl_dataset.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/tools/asl_source.h"

namespace autocal_vio {
namespace {

struct Stream {
  std::vector<TimeNs> images;
  std::vector<TimeNs> imu;
  bool in_order = true;
};

Stream readAll(DatasetReader* reader) {
  Stream stream;
  TimeNs last = 0;
  while (const std::optional<DatasetItem> item = reader->next()) {
    const bool is_image = std::holds_alternative<ImageFrame>(*item);
    const TimeNs stamp = is_image ? std::get<ImageFrame>(*item).stamp : std::get<ImuSample>(*item).stamp;
    stream.in_order = stream.in_order && stamp >= last;
    last = stamp;
    (is_image ? stream.images : stream.imu).push_back(stamp);
  }
  return stream;
}

class AslDataset : public ::testing::Test {
 protected:
  std::unique_ptr<AslSource> open(const std::string& name) {
    const std::optional<std::string> mav0 = findAslFolder(folder_.path(name));
    if (!mav0) throw LoadProblems({"no folder"});
    return std::make_unique<AslSource>(*mav0, [this](const std::string& text) { warnings_.push_back(text); });
  }

  std::string csv(const std::string& sensor) { return folder_.path("data/mav0/" + sensor + "/data.csv"); }

  TemporaryFolder folder_;
  std::vector<std::string> warnings_;
};

TEST_F(AslDataset, MergesInOrderOfStampWithAMarginOfImu) {
  writeAslDataset(folder_, "data", 4);
  DatasetReader reader(open("data"), {});
  const Stream stream = readAll(&reader);
  EXPECT_TRUE(stream.in_order);
  ASSERT_EQ(stream.images.size(), 4u);
  EXPECT_EQ(stream.images.front(), kAslBegin);
  EXPECT_EQ(stream.imu.front(), kAslBegin - kNsPerSecond);
  EXPECT_EQ(stream.imu.back(), kAslBegin + 150000000 + kNsPerSecond);
  EXPECT_EQ(stream.imu.size(), 431u);  // 200 Hz over 2.15 s, both ends
  EXPECT_EQ(reader.progress(), 1.0);
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(AslDataset, WindowIsRelativeToTheFirstImage) {
  writeAslDataset(folder_, "data", 20);
  DatasetReader reader(open("data"), {0.12, 0.3});
  const Stream stream = readAll(&reader);
  ASSERT_EQ(stream.images.size(), 6u);  // 0.15 to 0.40 s
  EXPECT_EQ(stream.images.front(), kAslBegin + 150000000);
  EXPECT_EQ(stream.images.back(), kAslBegin + 400000000);
  EXPECT_EQ(reader.firstImageStamp(), kAslBegin + 150000000);
  EXPECT_THROW(DatasetReader(open("data"), {10.0, std::nullopt}), LoadProblems);
}

TEST_F(AslDataset, SkipsCorruptRowsAndNamesThem) {
  writeAslDataset(folder_, "data", 4);
  std::string imu = readWholeFile(csv("imu0"));
  const std::size_t third_row = imu.find('\n', imu.find('\n', imu.find('\n') + 1) + 1) + 1;
  imu.insert(third_row, "1000000000100000000,0,0,nan,0,9.81,0\n123,1,2\nabc,0,0,0,0,0,0\n");
  folder_.write("data/mav0/imu0/data.csv", imu);
  folder_.write("data/mav0/cam0/data.csv", readWholeFile(csv("cam0")) + "1000000000900000000\n");
  DatasetReader reader(open("data"), {});
  EXPECT_EQ(readAll(&reader).images.size(), 4u);
  EXPECT_EQ(reader.source().badImu(), 3u);
  EXPECT_EQ(reader.source().badImages(), 1u);
  ASSERT_EQ(warnings_.size(), 4u);
  EXPECT_NE(warnings_[0].find("imu0/data.csv:4: expected a stamp"), std::string::npos) << warnings_[0];
  EXPECT_NE(warnings_[3].find("cam0/data.csv:6:"), std::string::npos) << warnings_[3];
}

TEST_F(AslDataset, SkipsImagesThatCannotBeRead) {
  writeAslDataset(folder_, "data", 4);
  const std::string images = "data/mav0/cam0/data/";
  folder_.write(images + std::to_string(kAslBegin) + ".png", "no image at all");
  std::string damaged = readWholeFile(folder_.path(images + std::to_string(kAslBegin + 50000000) + ".png"));
  folder_.write(images + std::to_string(kAslBegin + 50000000) + ".png", damaged.substr(0, 20));
  std::filesystem::remove(folder_.path(images + std::to_string(kAslBegin + 100000000) + ".png"));
  DatasetReader reader(open("data"), {});
  const Stream stream = readAll(&reader);
  ASSERT_EQ(stream.images.size(), 1u);
  EXPECT_EQ(stream.images[0], kAslBegin + 150000000);
  EXPECT_EQ(reader.source().badImages(), 3u);
  EXPECT_EQ(warnings_.size(), 3u);
}

TEST_F(AslDataset, RefusesWhatIsNoDataSet) {
  std::filesystem::create_directory(folder_.path("empty"));
  EXPECT_FALSE(findAslFolder(folder_.path("empty")));
  writeAslDataset(folder_, "data", 2);
  EXPECT_TRUE(findAslFolder(folder_.path("data/mav0")));
  folder_.write("data/mav0/cam0/data.csv", "#timestamp [ns],filename\n");
  EXPECT_THROW(open("data"), LoadProblems);
  std::filesystem::remove(csv("imu0"));
  EXPECT_THROW(open("data"), LoadProblems);
}

}  // namespace
}  // namespace autocal_vio
