#include "autocal_vio/common/angle.h"
#include "autocal_vio/tools/command_line.h"

#include <gtest/gtest.h>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/tools/calibrate_options.h"
#include "temporary_folder.h"

namespace autocal_vio {
namespace {

CalibrateOptions parsed(const std::vector<std::string>& arguments) {
  CalibrateOptions options;
  calibrateCommandLine(&options).parse(arguments);
  checkCalibrateOptions(options);
  return options;
}

std::string helpText() {
  CalibrateOptions options;
  return calibrateCommandLine(&options).help();
}

std::string reasonOf(const std::vector<std::string>& arguments) {
  try {
    parsed(arguments);
  } catch (const LoadProblems& error) {
    return error.oneLine();
  }
  return "";
}

TEST(CommandLine, TakesBothNotationsInAnyOrder) {
  const CalibrateOptions options = parsed({"in.bag", "--out=results", "--config", "rig.yaml", "--start",
                                           "1.5", "--duration=-0", "--force", "--duration=3"});
  EXPECT_EQ(options.dataset.input, "in.bag");
  EXPECT_EQ(options.output_folder, "results");
  EXPECT_EQ(options.dataset.rig_file, "rig.yaml");
  EXPECT_EQ(options.window.start, 1.5);
  EXPECT_EQ(options.window.duration, 3.0);
  EXPECT_TRUE(options.force);
  EXPECT_FALSE(options.fix_extrinsics);
  EXPECT_EQ(parsed({"--out", "o", "--", "--odd-name"}).dataset.input, "--odd-name");
}

TEST(CommandLine, ListsEverythingWrong) {
  const std::string reason =
      reasonOf({"--colour", "--start", "soon", "--force=yes", "a.bag", "b.bag", "--out"});
  for (const char* part :
       {"--colour: is not a known option", "--start: expected a number, is 'soon'", "--force: takes no value",
        "'b.bag': one argument too many", "--out: expected a value DIR"})
    EXPECT_NE(reason.find(part), std::string::npos) << part << " in " << reason;
  EXPECT_NE(reasonOf({"--out", "o"}).find("INPUT: is missing"), std::string::npos);
}

TEST(CommandLine, RefusesInconsistentOptions) {
  EXPECT_NE(reasonOf({"a.bag"}).find("--out: is missing"), std::string::npos);
  EXPECT_NE(reasonOf({"a.bag", "--out=o", "--start=-1"}).find("--start"), std::string::npos);
  EXPECT_NE(reasonOf({"a.bag", "--out=o", "--duration=0"}).find("--duration"), std::string::npos);
  EXPECT_NE(reasonOf({"a.bag", "--out=o", "--imu-link=i"}).find("without --initial"), std::string::npos);
  EXPECT_NE(
      reasonOf({"a.bag", "--out=o", "--initial=r.urdf", "--imu-link=i"}).find("--camera-link: is missing"),
      std::string::npos);
  EXPECT_EQ(reasonOf({"a.bag", "--out=o", "--initial=k.yaml", "--initial-sigma-translation=0.1"}), "");
}

TEST(CommandLine, HelpNamesEveryOption) {
  const std::string help = helpText();
  for (const char* name :
       {"--config", "--image-topic", "--imu-topic", "--start", "--duration", "--initial", "--fix-extrinsics",
        "--out", "--force", "--camera-link", "--imu-link", "--progress"})
    EXPECT_NE(help.find(name), std::string::npos) << name;
  EXPECT_NE(help.find("bytes of these"), std::string::npos);
  EXPECT_TRUE(CommandLine::asksForHelp({"in.bag", "--help"}));
}

TEST(CommandLine, InitialFileBecomesThePrior) {
  const TemporaryFolder folder;
  const std::string mount = folder.write("mount.yaml", R"(cam0:
  T_cam_imu:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.2]
  - [0.0, 0.0, 1.0, 0.3]
  - [0.0, 0.0, 0.0, 1.0]
  sigma_rotation_deg: 2
  timeshift_cam_imu: 0.004
)");
  RigModel rig;
  applyInitialFile(parsed({"a", "--out=o", "--initial", mount, "--initial-sigma-translation=0.05"}), &rig);
  ASSERT_TRUE(rig.extrinsics_prior);
  EXPECT_LT((rig.extrinsics_prior->T_imu_cam.translation + Eigen::Vector3d(0.1, 0.2, 0.3)).norm(), 1e-15);
  EXPECT_NEAR(rig.extrinsics_prior->sigma_rotation, 2.0 * kDegree, 1e-15);
  EXPECT_EQ(rig.extrinsics_prior->sigma_translation, 0.05);
  EXPECT_EQ(rig.time_offset_prior.td, 0.004);

  const std::string robot = folder.write("robot.urdf", R"(<robot name="r"><link name="imu"/><link name="cam"/>
<joint name="j" type="fixed"><parent link="imu"/><child link="cam"/><origin xyz="1 2 3"/></joint></robot>)");
  RigModel other;
  applyInitialFile(parsed({"a", "--out=o", "--initial", robot, "--imu-link=imu", "--camera-link=cam"}),
                   &other);
  ASSERT_TRUE(other.extrinsics_prior);
  EXPECT_LT((other.extrinsics_prior->T_imu_cam.translation - Eigen::Vector3d(1, 2, 3)).norm(), 1e-15);
  EXPECT_EQ(other.extrinsics_prior->sigma_translation, kDefaultSigmaTranslation);
}

}  // namespace
}  // namespace autocal_vio
