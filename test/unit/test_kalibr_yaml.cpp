#include "autocal_vio/calibration_io/kalibr_yaml.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <limits>

#include "autocal_vio/calibration_io/number_text.h"
#include "autocal_vio/calibration_io/rig_file.h"
#include "autocal_vio/calibration_io/text_file.h"
#include "autocal_vio/geometry/so3.h"
#include "temporary_folder.h"

namespace autocal_vio {
namespace {

KalibrCamchain exampleCamchain() {
  KalibrCamchain camchain;
  camchain.camera.distortion_model = DistortionModel::kEquidistant;
  camchain.camera.intrinsics << 190.97847715128717, 190.9733070521226, 254.93170605935475, 256.8974428996504;
  camchain.camera.distortion_coeffs << 0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202,
      0.00020293673591811182;
  camchain.camera.width = 512;
  camchain.camera.height = 512;
  camchain.camera.sigma_principal_point = 1.25;
  camchain.camera.readout_time = 0.015;
  camchain.image_topic = "/it's/image";
  camchain.T_imu_cam =
      Transform(expSo3(Eigen::Vector3d(0.4, -1.2, 2.1)), Eigen::Vector3d(0.05, -0.07, 1.0 / 3.0));
  camchain.td = -0.0123456789;
  camchain.sigma_rotation = 0.001;
  camchain.sigma_translation = 0.002;
  camchain.sigma_td = 0.0003;
  camchain.comment = "two lines\nof comment";
  return camchain;
}

TEST(KalibrYaml, RoundTripOfRossLensModels) {
  const TemporaryFolder folder;
  const std::string imu =
      "imu0: {update_rate: 200.0, accelerometer_noise_density: 0.01, accelerometer_random_walk: 0.0002,"
      " gyroscope_noise_density: 0.005, gyroscope_random_walk: 4.0e-06}\n";
  KalibrCamchain camchain = exampleCamchain();
  camchain.camera.distortion_model = DistortionModel::kRadialTangential;
  for (const Eigen::Vector4d& higher :
       {Eigen::Vector4d(0.0, 0.0, 0.0, 0.0), Eigen::Vector4d(0.1, 0.0, 0.0, 0.0),
        Eigen::Vector4d(0.1, 0.2, 0.3, 0.4), Eigen::Vector4d(0.0, 0.0, 0.0, 0.4)}) {
    camchain.camera.higher_radial_coeffs = higher;
    const RigModel rig = loadRigFile(folder.write("rig.yaml", kalibrCamchainText(camchain) + imu));
    ASSERT_TRUE(rig.camera);
    EXPECT_EQ(rig.camera->distortion_model, DistortionModel::kRadialTangential);
    EXPECT_EQ(rig.camera->distortion_coeffs, camchain.camera.distortion_coeffs);
    EXPECT_EQ(rig.camera->higher_radial_coeffs, higher);
  }
}

TEST(KalibrYaml, RoundTrip) {
  const TemporaryFolder folder;
  const KalibrCamchain camchain = exampleCamchain();
  const std::string path = folder.path("camchain-imucam.yaml");
  ASSERT_EQ(writeKalibrCamchain(path, camchain), std::nullopt);
  const std::string imu =
      folder.write("imu.yaml",
                   "rostopic: /imu0\nupdate_rate: 200.0\naccelerometer_noise_density: 0.01\n"
                   "accelerometer_random_walk: 0.0002\ngyroscope_noise_density: 0.005\n"
                   "gyroscope_random_walk: 4.0e-06\n");
  const RigModel rig = loadRigFile(path, imu);
  ASSERT_TRUE(rig.camera);
  EXPECT_EQ(rig.camera->intrinsics, camchain.camera.intrinsics);
  EXPECT_EQ(rig.camera->distortion_coeffs, camchain.camera.distortion_coeffs);
  EXPECT_EQ(rig.camera->distortion_model, DistortionModel::kEquidistant);
  EXPECT_EQ(rig.camera->width, 512);
  EXPECT_EQ(rig.camera->sigma_principal_point, 1.25);
  EXPECT_EQ(rig.camera->readout_time, 0.015);
  EXPECT_EQ(rig.image_topic, "/it's/image");
  ASSERT_TRUE(rig.extrinsics_prior);
  const Transform difference = rig.extrinsics_prior->T_imu_cam.inverse() * *camchain.T_imu_cam;
  EXPECT_LT(difference.translation.norm(), 1e-14);
  EXPECT_LT(logSo3(difference.rotation).norm(), 1e-14);
  EXPECT_EQ(rig.time_offset_prior.td, camchain.td);
  EXPECT_EQ(rig.time_offset_prior.sigma_td, 0.0003);
  EXPECT_NEAR(rig.extrinsics_prior->sigma_rotation, 0.001, 1e-16);
  EXPECT_EQ(rig.extrinsics_prior->sigma_translation, 0.002);
}

TEST(KalibrYaml, WithoutATransformOnlyTheCameraIsWritten) {
  const TemporaryFolder folder;
  KalibrCamchain camchain = exampleCamchain();
  camchain.T_imu_cam.reset();
  const std::string path = folder.path("camchain-imucam.yaml");
  ASSERT_EQ(writeKalibrCamchain(path, camchain), std::nullopt);
  const std::string text = readWholeFile(path);
  for (const char* part : {"T_cam_imu", "timeshift_cam_imu:", "sigma_rotation", "sigma_timeshift"})
    EXPECT_EQ(text.find(part), std::string::npos);
  EXPECT_NE(text.find("intrinsics: [190.97847715128717"), std::string::npos);
}

TEST(KalibrYaml, RefusesWhatIsNotFiniteAndKeepsTheOldFile) {
  const TemporaryFolder folder;
  const std::string path = folder.write("camchain-imucam.yaml", "old");
  KalibrCamchain camchain = exampleCamchain();
  camchain.td = std::numeric_limits<double>::quiet_NaN();
  ASSERT_TRUE(writeKalibrCamchain(path, camchain));
  EXPECT_EQ(readWholeFile(path), "old");
}

TEST(AtomicFile, ReplacesAndLeavesNothingBeside) {
  const TemporaryFolder folder;
  const std::string path = folder.write("file", "old");
  ASSERT_EQ(::chmod(path.c_str(), 0640), 0);
  EXPECT_EQ(writeFileAtomically(path, "new"), std::nullopt);
  EXPECT_EQ(readWholeFile(path), "new");
  struct stat status;
  ASSERT_EQ(::stat(path.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 07777, 0640u);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(AtomicFile, ASymbolicLinkStaysOne) {
  const TemporaryFolder folder;
  const std::string path = folder.write("file", "old"), link = folder.path("link");
  std::filesystem::create_symlink("file", link);
  EXPECT_EQ(writeFileAtomically(link, "new"), std::nullopt);
  EXPECT_TRUE(std::filesystem::is_symlink(link));
  EXPECT_EQ(readWholeFile(path), "new");
}

// A rename would replace the device, and reading a pipe would wait for ever.
TEST(AtomicFile, SpecialFilesAreRefused) {
  const TemporaryFolder folder;
  const std::string pipe = folder.path("pipe");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const std::optional<std::string> problem = writeFileAtomically(pipe, "new");
  ASSERT_TRUE(problem);
  EXPECT_NE(problem->find("no regular file"), std::string::npos) << *problem;
  EXPECT_TRUE(std::filesystem::is_fifo(pipe));
  EXPECT_FALSE(readTextFile(pipe));
}

TEST(AtomicFile, FailureNamesTheReasonAndLeavesNothing) {
  const TemporaryFolder folder;
  const std::optional<std::string> missing = writeFileAtomically(folder.path("no/such/folder/file"), "new");
  ASSERT_TRUE(missing);
  EXPECT_NE(missing->find("No such file or directory"), std::string::npos);

  std::filesystem::create_directory(folder.path("target"));  // a folder cannot be replaced by a file
  EXPECT_TRUE(writeFileAtomically(folder.path("target"), "new"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(NumberText, IsShortAndReadsBack) {
  EXPECT_EQ(shortestText(0.1), "0.1");
  EXPECT_EQ(shortestText(-3.0), "-3");
  EXPECT_EQ(shortestText(0.0), "0");
  EXPECT_EQ(shortestText(180.0), "180");
  for (double value : {1.0 / 3.0, 1e-300, 6.02214076e23, std::numeric_limits<double>::denorm_min()})
    EXPECT_EQ(std::strtod(shortestText(value).c_str(), nullptr), value);
}

}  // namespace
}  // namespace autocal_vio
