// Runs the offline programs as a user does: files in, files and exit status out.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "asl_dataset.h"
#include "autocal_vio/common/time.h"

namespace autocal_vio {
namespace {

constexpr int kImages = 30;
const char* const kResults[] = {"odometry.tum", "extrinsics.csv", "report.yaml", "convergence.png",
                                "camchain-imucam.yaml"};

std::string readResult(const std::string& folder, const std::string& name) {
  const std::string text = readWholeFile(folder + "/" + name);
  return name == "report.yaml" ? text.substr(0, text.find("# --- run time")) : text;  // timings differ
}

class Programs : public ::testing::Test {
 protected:
  /// Exit status; what the program prints goes to out_ and errors_.
  int run(const std::string& program, const std::string& arguments) {
    const std::string command = std::string(AUTOCAL_VIO_PROGRAMS) + "/" + program + " " + arguments + " > " +
                                folder_.path("stdout") + " 2> " + folder_.path("stderr");
    const int status = std::system(command.c_str());
    out_ = readWholeFile(folder_.path("stdout"));
    errors_ = readWholeFile(folder_.path("stderr"));
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  int calibrate(const std::string& arguments) { return run("calibrate_bag", arguments); }

  /// Bad input: exit status 1 and one line that contains `part`.
  void expectRefused(const std::string& arguments, const std::string& part) {
    EXPECT_EQ(calibrate(arguments), 1) << arguments << "\n" << errors_;
    EXPECT_EQ(errors_.find('\n'), errors_.size() - 1) << errors_;
    EXPECT_NE(errors_.find(part), std::string::npos) << errors_;
  }

  std::string at(const std::string& name) const { return folder_.path(name); }

  TemporaryFolder folder_;
  std::string out_;
  std::string errors_;
};

TEST_F(Programs, HelpAndSettings) {
  EXPECT_EQ(calibrate("--help"), 0);
  EXPECT_NE(out_.find("usage: calibrate_bag"), std::string::npos);
  EXPECT_EQ(calibrate("--print-estimator-settings"), 0);
  EXPECT_EQ(out_, readWholeFile(AUTOCAL_VIO_CONFIG_FOLDER "/estimator.yaml"));
  EXPECT_EQ(run("asl_to_bag", "--help"), 0);
  EXPECT_EQ(run("calibrate_simulation", "--help"), 0);
}

// Without a master, for which they would wait.
TEST_F(Programs, NodesAnswerAndRefuseArguments) {
  for (const char* const node : {"vio_node", "simulated_rig_node"}) {
    EXPECT_EQ(run(node, "--help"), 0);
    EXPECT_NE(out_.find("docs/parameters.md"), std::string::npos) << out_;
    EXPECT_EQ(run(node, "--rig-file rig.yaml"), 1);
    EXPECT_NE(errors_.find("--rig-file"), std::string::npos) << errors_;
  }
}

TEST_F(Programs, BadInputIsRefusedInOneLine) {
  const std::string data = writeAslDataset(folder_, "data", 3), out = " --out " + at("out") + " ";
  std::filesystem::create_directory(at("empty"));
  folder_.write("rig.yaml", "cam0:\n  camera_model: omni\nimu0: {}\n");
  folder_.write("text.bag", "this is no bag");
  folder_.write("file", "");
  expectRefused("", "INPUT: is missing");
  expectRefused(data, "--out: is missing");
  expectRefused(out + at("nowhere"), "nowhere: does not exist");
  expectRefused(out + at("empty"), "expected a bag, or a folder with mav0/");
  expectRefused(out + at("text.bag"), "cannot be read as a bag");
  expectRefused(out + data + " --config " + at("rig.yaml"),
                "rig.yaml:2: cam0.camera_model: expected pinhole");
  expectRefused(out + data + " --config " + at("none.yaml"), "none.yaml: cannot be read");
  expectRefused(out + data + " --initial " + at("none.yaml"), "none.yaml: cannot be read");
  expectRefused(out + data + " --estimator " + at("rig.yaml"), "is not a known key");
  expectRefused(out + data + " --fix-extrinsics", "--fix-extrinsics: needs a transform");
  expectRefused(out + data + " --start 100", "no image lies in the window");
  expectRefused("--out " + at("file/out") + " " + data, "cannot be created");
  std::filesystem::remove_all(at("data/mav0/cam0/data.csv"));
  expectRefused(out + data, "cam0/data.csv: cannot be read");
  EXPECT_FALSE(std::filesystem::exists(at("out"))) << "a folder for results that there are none of";
}

TEST_F(Programs, StandstillIsProcessedButDoesNotConverge) {
  const std::string data = writeAslDataset(folder_, "data", kImages);
  EXPECT_EQ(calibrate("--out " + at("a") + " " + data), 2) << errors_;
  EXPECT_EQ(out_.rfind("not_converged: ", 0), 0u) << out_;
  for (const char* name : kResults) EXPECT_TRUE(std::filesystem::exists(at("a/") + name)) << name;
  EXPECT_EQ(readWholeFile(at("a/camchain-imucam.yaml")).find("T_cam_imu:"), std::string::npos)
      << "a transform that was never estimated";
  const std::string report = readWholeFile(at("a/report.yaml"));
  EXPECT_NE(report.find("images_processed: " + std::to_string(kImages) + "\n"), std::string::npos) << report;
  EXPECT_NE(report.find("images_dropped: 0\n"), std::string::npos) << report;

  expectRefused("--out " + at("a") + " " + data, "exists already; --force overwrites it");
  EXPECT_EQ(calibrate("--force --quiet --out " + at("a") + " " + data), 2);
  EXPECT_EQ(errors_, "");
  EXPECT_EQ(calibrate("--out " + at("b") + " " + data), 2);
  for (const char* name : kResults) EXPECT_EQ(readResult(at("a"), name), readResult(at("b"), name)) << name;
}

TEST_F(Programs, DamagedDataAreSkippedAndCounted) {
  const std::string data = writeAslDataset(folder_, "data", kImages);
  folder_.write("data/mav0/cam0/data/" + std::to_string(kAslBegin + 50000000) + ".png", "no image");
  std::ofstream(at("data/mav0/imu0/data.csv"), std::ios::app) << "not,a,row\n";
  EXPECT_EQ(calibrate("--out " + at("a") + " " + data), 2) << errors_;
  EXPECT_NE(errors_.find("cannot be read as an image"), std::string::npos) << errors_;
  EXPECT_NE(errors_.find("imu0/data.csv:1102: expected a stamp"), std::string::npos) << errors_;
  const std::string report = readWholeFile(at("a/report.yaml"));
  EXPECT_NE(report.find("images_processed: 29\nimages_dropped: 1\nimages_unreadable: 1\n"), std::string::npos)
      << report;
  EXPECT_NE(report.find("imu_unusable: 1\n"), std::string::npos) << report;
}

TEST_F(Programs, OneWildStampCostsNothingElse) {
  const std::string data = writeAslDataset(folder_, "data", kImages);
  const long long hour = 3600000000000LL;
  const auto shift = [this](const std::string& table, long long stamp, long long by) {
    std::string text = readWholeFile(at("data/mav0/" + table));
    const std::string row = "\n" + std::to_string(stamp) + ",";
    ASSERT_NE(text.find(row), std::string::npos);
    folder_.write("data/mav0/" + table,
                  text.replace(text.find(row), row.size(), "\n" + std::to_string(stamp + by) + ","));
  };
  shift("imu0/data.csv", kAslBegin + 300000000, hour);
  shift("imu0/data.csv", kAslBegin + 700000000, -hour);
  shift("cam0/data.csv", kAslBegin + 450000000, hour);
  EXPECT_EQ(calibrate("--out " + at("a") + " " + data), 2) << errors_;
  EXPECT_NE(errors_.find("data: IMU sample at 1000003600.300000000 s: its stamp lies 3600.005 s ahead"),
            std::string::npos)
      << errors_;
  EXPECT_NE(errors_.find("data: image at 1000003600.450000000 s"), std::string::npos) << errors_;
  const std::string report = readWholeFile(at("a/report.yaml"));
  EXPECT_NE(report.find("images_processed: 29\nimages_dropped: 1\n"), std::string::npos) << report;
  EXPECT_NE(report.find("imu_unusable: 2\n"), std::string::npos) << report;
}

TEST_F(Programs, ImuDataThatEndEarlyAreNamedAndTheImagesCounted) {
  const std::string data = writeAslDataset(folder_, "data", 100);
  const std::string table = readWholeFile(at("data/mav0/imu0/data.csv"));
  folder_.write("data/mav0/imu0/data.csv",
                table.substr(0, table.find("\n" + std::to_string(kAslBegin + kNsPerSecond)) + 1));
  EXPECT_EQ(calibrate("--out " + at("a") + " " + data), 2) << errors_;
  EXPECT_NE(errors_.find("the IMU data end 3.96 s before the last image: 80 images were not processed"),
            std::string::npos)
      << errors_;
  const std::string report = readWholeFile(at("a/report.yaml"));
  EXPECT_NE(
      report.find("images_processed: 20\nimages_dropped: 80\nimages_unreadable: 0\nimages_uncovered: 80"),
      std::string::npos)
      << report;
  EXPECT_NE(out_.find("the images of the last 4.0 s were not processed"), std::string::npos) << out_;
}

TEST_F(Programs, ADamagedBagKeepsTheResultsSoFar) {
  const std::string data = writeAslDataset(folder_, "data", kImages);
  ASSERT_EQ(run("asl_to_bag", data + " " + at("data.bag")), 0) << errors_;
  std::string bag = readWholeFile(at("data.bag"));
  const std::string header = "compression=";
  std::size_t chunk = 0;
  for (int i = 0; i < 6; ++i) chunk = bag.find(header, chunk + 1);
  ASSERT_NE(chunk, std::string::npos);
  folder_.write("data.bag", bag.replace(chunk + header.size(), 4, "what"));
  EXPECT_EQ(calibrate("--out " + at("a") + " " + at("data.bag")), 2) << errors_;
  EXPECT_NE(errors_.find("data.bag: /cam0/image_raw: cannot be read after the message of 1000000000."),
            std::string::npos)
      << errors_;
  EXPECT_NE(out_.find("the input ended early: "), std::string::npos) << out_;
  for (const char* name : kResults) EXPECT_TRUE(std::filesystem::exists(at("a/") + name)) << name;
  const std::string report = readWholeFile(at("a/report.yaml"));
  EXPECT_EQ(report.find("images_processed: 0\n"), std::string::npos) << report;
}

TEST_F(Programs, ABagGivesTheSameTablesAsItsFolder) {
  const std::string data = writeAslDataset(folder_, "data", kImages);
  ASSERT_EQ(run("asl_to_bag", data + " " + at("data.bag")), 0) << errors_;
  EXPECT_EQ(run("asl_to_bag", data + " " + at("data.bag")), 1);
  EXPECT_NE(errors_.find("--force overwrites it"), std::string::npos) << errors_;
  EXPECT_EQ(run("asl_to_bag", "--force " + data + " " + at("data.bag")), 0);
  EXPECT_FALSE(std::filesystem::exists(at("data.bag.part")));

  const std::string rig = std::string(" --config ") + AUTOCAL_VIO_CONFIG_FOLDER + "/euroc.yaml ";
  ASSERT_EQ(calibrate("--out " + at("folder") + rig + data), 2) << errors_;
  ASSERT_EQ(calibrate("--out " + at("bag") + rig + at("data.bag")), 2) << errors_;
  for (const char* name : {"odometry.tum", "extrinsics.csv"})
    EXPECT_EQ(readResult(at("folder"), name), readResult(at("bag"), name)) << name;
  EXPECT_EQ(calibrate("--out " + at("info") + " " + at("data.bag")), 2)
      << "camera_info serves as well: " << errors_;

  expectRefused("--out " + at("x") + rig + at("data.bag") + " --image-topic /other",
                "has no image topic /other (it has: /cam0/image_raw)");
  expectRefused("--out " + at("x") + rig + at("data.bag") + " --imu-topic /other", "(it has: /imu0)");
}

}  // namespace
}  // namespace autocal_vio
