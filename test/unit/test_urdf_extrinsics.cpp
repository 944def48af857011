#include "autocal_vio/calibration_io/urdf_extrinsics.h"

#include <gtest/gtest.h>

#include "autocal_vio/calibration_io/load_problems.h"
#include "temporary_folder.h"

namespace autocal_vio {
namespace {

// base -> imu; base -> mast -> camera -> optical; base -> arm (moves) -> hand.
const char* const kRobot = R"(<?xml version="1.0"?>
<robot name="rig">
  <link name="base"/> <link name="imu"/> <link name="mast"/> <link name="camera"/> <link name="optical"/>
  <link name="arm"/> <link name="hand"/>
  <joint name="imu_joint" type="fixed">
    <parent link="base"/> <child link="imu"/> <origin xyz="0.1 0 0" rpy="0 0 0"/>
  </joint>
  <joint name="mast_joint" type="fixed">
    <parent link="base"/> <child link="mast"/> <origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/>
  </joint>
  <joint name="camera_joint" type="fixed">
    <parent link="mast"/> <child link="camera"/> <origin xyz="0.2 0 0" rpy="0 0 0"/>
  </joint>
  <joint name="optical_joint" type="fixed">
    <parent link="camera"/> <child link="optical"/> <origin rpy="-1.5707963267948966 0 -1.5707963267948966"/>
  </joint>
  <joint name="shoulder" type="revolute">
    <parent link="base"/> <child link="arm"/> <axis xyz="0 0 1"/> <limit effort="1" velocity="1" lower="0" upper="1"/>
  </joint>
  <joint name="hand_joint" type="fixed"> <parent link="arm"/> <child link="hand"/> </joint>
</robot>
)";

std::string reasonOf(const std::string& path, const std::string& imu, const std::string& camera) {
  try {
    loadUrdfExtrinsics(path, imu, camera);
  } catch (const LoadProblems& error) {
    return error.what();
  }
  return "";
}

TEST(UrdfExtrinsics, FollowsFixedJointsUpAndDown) {
  const TemporaryFolder folder;
  const std::string path = folder.write("robot.urdf", kRobot);
  const Transform T_imu_cam = loadUrdfExtrinsics(path, "imu", "optical");
  EXPECT_LT((T_imu_cam.translation - Eigen::Vector3d(-0.1, 0.2, 1.0)).norm(), 1e-12);
  // The mast looks along the base's y: so does the optical frame's z; its y points down.
  EXPECT_LT((T_imu_cam.rotation * Eigen::Vector3d::UnitZ() - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  EXPECT_LT((T_imu_cam.rotation * Eigen::Vector3d::UnitY() + Eigen::Vector3d::UnitZ()).norm(), 1e-12);
  const Transform inverse = loadUrdfExtrinsics(path, "optical", "imu");
  EXPECT_LT(((inverse * T_imu_cam).matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-12);
  EXPECT_LT((loadUrdfExtrinsics(path, "imu", "imu").matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-12);
  EXPECT_LT((loadUrdfExtrinsics(path, "arm", "hand").matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-12);
}

TEST(UrdfExtrinsics, RefusesAMovableJointByName) {
  const TemporaryFolder folder;
  const std::string reason = reasonOf(folder.write("robot.urdf", kRobot), "imu", "hand");
  EXPECT_NE(reason.find("joint shoulder between the IMU and the camera is revolute"), std::string::npos)
      << reason;
}

TEST(UrdfExtrinsics, NamesWhatIsMissing) {
  const TemporaryFolder folder;
  const std::string path = folder.write("robot.urdf", kRobot);
  const std::string links = reasonOf(path, "imu9", "camera9");
  EXPECT_NE(links.find("no link imu9"), std::string::npos);
  EXPECT_NE(links.find("no link camera9"), std::string::npos);
  EXPECT_NE(reasonOf(folder.path("none.urdf"), "imu", "optical").find("cannot be read"), std::string::npos);
  EXPECT_NE(reasonOf(folder.write("a.urdf", "<robot name='a'>\n<link"), "a", "b").find("not valid XML"),
            std::string::npos);
  EXPECT_NE(reasonOf(folder.write("b.urdf", "<sdf/>"), "a", "b").find("expected <robot>"), std::string::npos);
  EXPECT_NE(
      reasonOf(folder.write("c.urdf", "<robot name='c'/>"), "a", "b").find("not a valid robot description"),
      std::string::npos);
}

}  // namespace
}  // namespace autocal_vio
