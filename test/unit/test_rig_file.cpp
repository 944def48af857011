#include "autocal_vio/calibration_io/rig_file.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <string>

#include "autocal_vio/calibration_io/asl_sensors.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/common/angle.h"
#include "temporary_folder.h"

namespace autocal_vio {
namespace {

const char* const kCamera = R"(cam0:
  camera_model: pinhole
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  distortion_model: radtan
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
)";

const char* const kImu = R"(imu0:
  accelerometer_noise_density: 2.0e-3
  accelerometer_random_walk: 3.0e-3
  gyroscope_noise_density: 1.6968e-4
  gyroscope_random_walk: 1.9393e-5
  update_rate: 200.0
  rostopic: /imu0
)";

// A quarter turn about x and a lever arm, IMU to camera.
const char* const kTCamImu = R"(  T_cam_imu:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 0.0, -1.0, 0.2]
  - [0.0, 1.0, 0.0, 0.3]
  - [0.0, 0.0, 0.0, 1.0]
)";

std::vector<std::string> problemsOf(const std::string& path, const std::string& imu_path = "") {
  try {
    loadRigFile(path, imu_path);
  } catch (const LoadProblems& error) {
    return error.problems();
  }
  return {};
}

bool anyContains(const std::vector<std::string>& texts, const std::string& part) {
  for (const std::string& text : texts) {
    if (text.find(part) != std::string::npos) return true;
  }
  return false;
}

TEST(RigFile, ReadsCameraAndImu) {
  const TemporaryFolder folder;
  const RigModel rig = loadRigFile(folder.write("rig.yaml", std::string(kCamera) + kImu));
  ASSERT_TRUE(rig.camera);
  EXPECT_EQ(rig.camera->distortion_model, DistortionModel::kRadialTangential);
  EXPECT_EQ(rig.camera->intrinsics, Eigen::Vector4d(458.654, 457.296, 367.215, 248.375));
  EXPECT_EQ(rig.camera->distortion_coeffs(3), 1.76187114e-05);
  EXPECT_EQ(rig.camera->width, 752);
  EXPECT_EQ(rig.camera->height, 480);
  EXPECT_EQ(rig.imu_noise.gyroscope_noise_density, 1.6968e-4);
  EXPECT_EQ(rig.imu_noise.accelerometer_random_walk, 3.0e-3);
  EXPECT_EQ(rig.image_topic, "/cam0/image_raw");
  EXPECT_EQ(rig.imu_topic, "/imu0");
  EXPECT_FALSE(rig.extrinsics_prior);
}

TEST(RigFile, TakesKalibrsDirectionAndItsInverse) {
  const TemporaryFolder folder;
  const RigModel kalibr = loadRigFile(folder.write("a.yaml", std::string(kCamera) + kTCamImu + kImu));
  ASSERT_TRUE(kalibr.extrinsics_prior);
  const Transform T_imu_cam = kalibr.extrinsics_prior->T_imu_cam;
  EXPECT_LT((T_imu_cam * Eigen::Vector3d(0.1, 0.2, 0.3)).norm(), 1e-15);  // IMU origin seen from the camera
  EXPECT_LT((T_imu_cam.translation - Eigen::Vector3d(-0.1, -0.3, 0.2)).norm(), 1e-15);
  EXPECT_NEAR(kalibr.extrinsics_prior->sigma_rotation, kDefaultSigmaRotationDeg * kDegree, 1e-15);

  std::string inverse(kTCamImu);
  inverse.replace(inverse.find("T_cam_imu"), 9, "T_imu_cam");
  const std::string text = std::string(kCamera) + inverse +
                           "  sigma_rotation_deg: 0.3\n  sigma_translation: 0.004\n"
                           "  timeshift_cam_imu: -0.005\n  sigma_timeshift: 0.001\n" +
                           kImu;
  const RigModel own = loadRigFile(folder.write("b.yaml", text));
  EXPECT_LT((own.extrinsics_prior->T_imu_cam.translation - Eigen::Vector3d(0.1, 0.2, 0.3)).norm(), 1e-15);
  EXPECT_NEAR(own.extrinsics_prior->sigma_rotation, 0.3 * kDegree, 1e-15);
  EXPECT_EQ(own.extrinsics_prior->sigma_translation, 0.004);
  EXPECT_EQ(own.time_offset_prior.td, -0.005);
  EXPECT_EQ(own.time_offset_prior.sigma_td, 0.001);
}

TEST(RigFile, ReadsKalibrsFilesAsTheyAre) {
  const TemporaryFolder folder;
  const std::string chain = folder.write("camchain-imucam.yaml", R"(cam0:
  T_cam_imu:
  - [0.014865542981794, 0.999557249008346, -0.025774436697440, 0.065222909535531]
  - [-0.999880929698575, 0.014967213324719, 0.003756188357967, -0.020706385492719]
  - [0.004140296794224, 0.025715529947966, 0.999660727177902, -0.008054602460030]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.0006
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: omni
)");
  const std::string flat =
      folder.write("imu.yaml",
                   "rostopic: /imu0\nupdate_rate: 200.0\naccelerometer_noise_density: 0.01\n"
                   "accelerometer_random_walk: 0.0002\ngyroscope_noise_density: 0.005\n"
                   "gyroscope_random_walk: 4.0e-06\n");
  std::vector<std::string> notes;
  const RigModel rig = loadRigFile(chain, flat, &notes);
  EXPECT_EQ(rig.imu_noise.accelerometer_noise_density, 0.01);
  EXPECT_EQ(rig.time_offset_prior.td, 0.0006);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_TRUE(anyContains(notes, "cam1 is ignored; cam0 is used"));

  const std::string nested = folder.write("imu-results.yaml", std::string(kImu) +
                                                                  "  model: calibrated\n  time_offset: 0.0\n"
                                                                  "  T_i_b:\n  - [1.0, 0.0, 0.0, 0.0]\n"
                                                                  "  - [0.0, 1.0, 0.0, 0.0]\n"
                                                                  "  - [0.0, 0.0, 1.0, 0.0]\n"
                                                                  "  - [0.0, 0.0, 0.0, 1.0]\n");
  EXPECT_EQ(loadRigFile(chain, nested).imu_noise.accelerometer_noise_density, 2.0e-3);
  EXPECT_TRUE(anyContains(problemsOf(chain), "imu0: is missing"));

  const std::string two = folder.write(
      "two-imus.yaml", std::string(kImu) + "imu1:\n  model: scale-misalignment\n  update_rate: 100.0\n");
  notes.clear();
  EXPECT_EQ(loadRigFile(chain, two, &notes).imu_noise.accelerometer_noise_density, 2.0e-3);
  EXPECT_TRUE(anyContains(notes, "imu1 is ignored; imu0 is used"));
}

TEST(RigFile, AccuracyOfThePrincipalPointIsReadAndChecked) {
  const TemporaryFolder folder;
  const auto rigWith = [&](const std::string& line) {
    return folder.write("accuracy.yaml", R"(cam0:
  camera_model: pinhole
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  distortion_model: none
  distortion_coeffs: []
  resolution: [752, 480]
)" + line + R"(imu0:
  accelerometer_noise_density: 2.0e-3
  accelerometer_random_walk: 3.0e-3
  gyroscope_noise_density: 1.6968e-4
  gyroscope_random_walk: 1.9393e-5
  update_rate: 200
)");
  };
  EXPECT_EQ(loadRigFile(rigWith("")).camera->sigma_principal_point, 0.5);
  EXPECT_EQ(loadRigFile(rigWith("  sigma_principal_point: 0\n")).camera->sigma_principal_point, 0.0);
  EXPECT_EQ(loadRigFile(rigWith("  sigma_principal_point: 1.5\n")).camera->sigma_principal_point, 1.5);
  for (const char* bad : {"-1", "21", ".nan", "much"})
    EXPECT_TRUE(anyContains(problemsOf(rigWith("  sigma_principal_point: " + std::string(bad) + "\n")),
                            "sigma_principal_point"))
        << bad;
  EXPECT_EQ(loadRigFile(rigWith("")).camera->readout_time, 0.0);
  EXPECT_EQ(loadRigFile(rigWith("  readout_time: 0.02\n")).camera->readout_time, 0.02);
  for (const char* bad : {"-0.01", "0.2", ".nan", "soon"})
    EXPECT_TRUE(
        anyContains(problemsOf(rigWith("  readout_time: " + std::string(bad) + "\n")), "readout_time"))
        << bad;
}

TEST(RigFile, ListsEverythingWrongAtOnce) {
  const TemporaryFolder folder;
  const std::string path = folder.write("bad.yaml", R"(cam0:
  camera_model: omni
  intrinsics: [458.654, 457.296, 367.215]
  distortion_model: fov
  distortion_coeffs: [0, 0, 0, .nan]
  resolution: [752.5, 480]
  colour: blue
  T_cam_imu:
  - [2.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.2]
  - [0.0, 0.0, 1.0, 0.3]
  - [0.0, 0.0, 0.0, 1.0]
  sigma_translation: -1
imu0:
  accelerometer_noise_density: many
  accelerometer_random_walk: 3.0e-3
  gyroscope_noise_density: 1.6968e-4
  update_rate: 200
speed: 3
)");
  const std::vector<std::string> problems = problemsOf(path);
  for (const char* part :
       {"bad.yaml:2: cam0.camera_model: expected pinhole, is omni",
        "cam0.intrinsics: expected 4 finite numbers",
        "cam0.distortion_model: expected radtan, equidistant, plumb_bob, rational_polynomial or none, is fov",
        "cam0.distortion_coeffs: expected 4", "cam0.resolution: expected whole numbers",
        "bad.yaml:7: cam0.colour: is not a known key", "cam0.T_cam_imu: expected a rotation",
        "cam0.sigma_translation: must be above 0",
        "imu0.accelerometer_noise_density: expected a finite number",
        "imu0.gyroscope_random_walk: is missing", "bad.yaml:19: speed: is not a known key"}) {
    EXPECT_TRUE(anyContains(problems, part)) << part;
  }
  EXPECT_EQ(problems.size(), 11u) << ::testing::PrintToString(problems);
}

TEST(RigFile, ImpossibleValuesAreListedBesideUnreadableOnes) {
  const TemporaryFolder folder;
  const std::vector<std::string> problems = problemsOf(folder.write("bad.yaml", R"(cam0:
  camera_model: pinhole
  intrinsics: [-458.654, 457.296, 800, 248.375]
  distortion_model: fov
  distortion_coeffs: [0, 0, 500, 0]
  resolution: [752, 480]
imu0:
  accelerometer_noise_density: 1.0e6
  accelerometer_random_walk: many
  gyroscope_random_walk: 0
  update_rate: 200
)"));
  for (const char* part :
       {"cam0.distortion_model: expected radtan", "focal length fu must be above 1 px",
        "principal point pu must lie in the image", "distortion_coeffs[2] must be finite",
        "imu0.accelerometer_random_walk: expected a finite number",
        "imu0.gyroscope_noise_density: is missing", "accelerometer_noise_density must be within",
        "gyroscope_random_walk must be within"}) {
    EXPECT_TRUE(anyContains(problems, part)) << part;
  }
  EXPECT_EQ(problems.size(), 8u) << ::testing::PrintToString(problems);
}

// Of a webcam, whose intrinsics camera_info gives and whose shutter rolls.
TEST(RigFile, WhatCameraInfoDoesNotSayIsReadWithoutIntrinsics) {
  const TemporaryFolder folder;
  const auto rigWith = [&folder](const std::string& keys) {
    return folder.write("rig.yaml", "cam0:\n  rostopic: /image\n" + keys + kImu);
  };
  RigModel rig = loadRigFile(rigWith("  readout_time: 0.02\n  sigma_principal_point: 2\n"));
  EXPECT_FALSE(rig.camera);
  CameraIntrinsics camera;
  rig.completeCamera(&camera);
  EXPECT_EQ(camera.readout_time, 0.02);
  EXPECT_EQ(camera.sigma_principal_point, 2.0);
  rig = loadRigFile(rigWith(""));
  rig.completeCamera(&camera);
  EXPECT_EQ(camera.readout_time, 0.02) << "nothing said, nothing changed";
  const std::vector<std::string> problems = problemsOf(rigWith("  readout_time: 2\n"));
  ASSERT_EQ(problems.size(), 1u) << ::testing::PrintToString(problems);
  EXPECT_TRUE(anyContains(problems, "readout_time must be within"));
}

TEST(RigFile, WhatCannotBeReadIsComplainedAboutOnce) {
  const TemporaryFolder folder;
  std::string camera(kCamera);
  camera.replace(camera.find("[752, 480]"), 10, "[752]     ");
  std::vector<std::string> problems = problemsOf(folder.write("a.yaml", camera + kImu));
  EXPECT_EQ(problems.size(), 1u) << ::testing::PrintToString(problems);
  camera = kCamera;
  camera.replace(camera.find("458.654"), 7, "forty  ");
  problems = problemsOf(folder.write("b.yaml", camera + kImu));
  EXPECT_EQ(problems.size(), 1u) << ::testing::PrintToString(problems);
  problems = problemsOf(folder.write("c.yaml", std::string(kCamera) + "imu0: 3\n"));
  EXPECT_EQ(problems.size(), 1u) << ::testing::PrintToString(problems);
}

TEST(RigFile, AMissingImuIsNamedBesideOtherProblems) {
  const TemporaryFolder folder;
  const std::vector<std::string> problems =
      problemsOf(folder.write("rig.yaml", std::string(kCamera) + "  colour: blue\n"));
  ASSERT_EQ(problems.size(), 2u) << ::testing::PrintToString(problems);
  EXPECT_TRUE(anyContains(problems, "colour: is not a known key"));
  EXPECT_TRUE(anyContains(problems, "imu0: is missing"));
}

TEST(RigFile, RefusesImpossibleValues) {
  const TemporaryFolder folder;
  std::string camera(kCamera);
  camera.replace(camera.find("458.654"), 7, "-458.65");
  std::string imu(kImu);
  imu.replace(imu.find("200.0"), 5, "0.000");
  const std::vector<std::string> problems = problemsOf(folder.write("rig.yaml", camera + imu));
  EXPECT_EQ(problems.size(), 2u);
  EXPECT_TRUE(anyContains(problems, "focal length fu must be above 1 px"));
  EXPECT_TRUE(anyContains(problems, "update_rate must be within"));
}

TEST(RigFile, RefusesBothDirectionsAtOnce) {
  const TemporaryFolder folder;
  std::string inverse(kTCamImu);
  inverse.replace(inverse.find("T_cam_imu"), 9, "T_imu_cam");
  const std::vector<std::string> problems =
      problemsOf(folder.write("rig.yaml", std::string(kCamera) + kTCamImu + inverse + kImu));
  ASSERT_EQ(problems.size(), 1u);
  EXPECT_TRUE(anyContains(problems, "stands beside T_cam_imu"));
}

TEST(RigFile, NamesFilesThatCannotBeRead) {
  const TemporaryFolder folder;
  EXPECT_TRUE(anyContains(problemsOf(folder.path("none.yaml")), "none.yaml: cannot be read"));
  EXPECT_TRUE(anyContains(problemsOf(folder.path()), "cannot be read"));  // a folder
  EXPECT_TRUE(anyContains(problemsOf(folder.write("a.yaml", "cam0: [1, 2\nimu0: 3")), "is not valid YAML"));
  EXPECT_TRUE(anyContains(problemsOf(folder.write("b.yaml", "just text")), "not a YAML map"));
  EXPECT_TRUE(anyContains(problemsOf(folder.write("c.yaml", "")), "not a YAML map"));
  EXPECT_TRUE(anyContains(problemsOf(folder.write("d.yaml", std::string(kCamera) + kCamera + kImu)),
                          "occurs more than once"));
}

TEST(RigFile, CameraWithoutIntrinsicsIsLeftToCameraInfo) {
  const TemporaryFolder folder;
  const RigModel rig =
      loadRigFile(folder.write("rig.yaml", std::string("cam0:\n  rostopic: /camera/image\n") + kImu));
  EXPECT_FALSE(rig.camera);
  EXPECT_EQ(rig.image_topic, "/camera/image");
}

TEST(RigFile, MountPriorNeedsOnlyTheTransform) {
  const TemporaryFolder folder;
  const MountPrior prior = loadMountPrior(folder.write("mount.yaml", std::string("cam0:\n") + kTCamImu));
  EXPECT_LT((prior.extrinsics.T_imu_cam.translation - Eigen::Vector3d(-0.1, -0.3, 0.2)).norm(), 1e-15);
  EXPECT_FALSE(prior.time_offset);
  EXPECT_THROW(loadMountPrior(folder.write("none.yaml", kCamera)), LoadProblems);
  try {
    loadMountPrior(folder.write("bad.yaml", "cam0:\n  timeshift_cam_imu: 5\n"));
    ADD_FAILURE() << "accepted";
  } catch (const LoadProblems& error) {
    EXPECT_EQ(error.problems().size(), 2u) << error.what();
    EXPECT_TRUE(anyContains(error.problems(), "expected T_cam_imu or T_imu_cam"));
  }
}

TEST(RigFile, EveryShippedFileLoads) {
  int count = 0;
  std::set<std::string> without_camera;
  for (const auto& entry : std::filesystem::directory_iterator(AUTOCAL_VIO_CONFIG_FOLDER)) {
    if (entry.path().extension() != ".yaml" || entry.path().stem() == "estimator") continue;
    const RigModel rig = loadRigFile(entry.path().string());
    if (rig.camera) {
      EXPECT_TRUE(rig.camera->validate().empty()) << entry.path();
    } else {
      without_camera.insert(entry.path().stem());
    }
    EXPECT_FALSE(rig.extrinsics_prior) << entry.path() << ": shipped rigs start from nothing";
    EXPECT_FALSE(rig.image_topic.empty()) << entry.path();
    EXPECT_FALSE(rig.imu_topic.empty()) << entry.path();
    ++count;
  }
  EXPECT_EQ(count, 6);
  // Each of these devices has intrinsics of its own.
  EXPECT_EQ(without_camera, (std::set<std::string>{"realsense_d435i", "realsense_d455", "usb_camera"}));
}

TEST(AslSensors, ReadsTheSensorsButTakesNoPrior) {
  const TemporaryFolder folder;
  folder.write("cam0/sensor.yaml", R"(%YAML:1.0
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.1,
         1.0, 0.0, 0.0, 0.2,
         0.0, 0.0, 1.0, 0.3,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
)");
  const std::string imu = R"(T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.6968e-04
gyroscope_random_walk: 1.9393e-05
accelerometer_noise_density: 2.0000e-3
)";
  folder.write("imu0/sensor.yaml", imu + "accelerometer_random_walk: 3.0000e-3\n");
  const RigModel rig = loadAslRig(folder.path());
  ASSERT_TRUE(rig.camera);
  EXPECT_EQ(rig.camera->intrinsics(0), 458.654);
  EXPECT_EQ(rig.camera->distortion_coeffs(0), -0.28340811);
  EXPECT_EQ(rig.imu_noise.update_rate, 200.0);
  EXPECT_FALSE(rig.extrinsics_prior);
  const std::optional<Transform> truth = loadAslExtrinsics(folder.path());
  ASSERT_TRUE(truth);
  EXPECT_LT((truth->translation - Eigen::Vector3d(0.1, 0.2, 0.3)).norm(), 1e-15);

  folder.write("imu0/sensor.yaml", imu.substr(0, imu.find("gyroscope_noise")) +
                                       "gyroscope_noise_density: -1\naccelerometer_noise_density: 2.0e-3\n");
  try {
    loadAslRig(folder.path());
    ADD_FAILURE() << "accepted";
  } catch (const LoadProblems& error) {
    EXPECT_EQ(error.problems().size(), 3u) << error.what();
    EXPECT_TRUE(anyContains(error.problems(), "gyroscope_noise_density must be within"));
  }
  folder.write("imu0/sensor.yaml", imu);
  EXPECT_THROW(loadAslRig(folder.path()), LoadProblems);
  EXPECT_THROW(loadAslRig(folder.path("nothing")), LoadProblems);
}

}  // namespace
}  // namespace autocal_vio
