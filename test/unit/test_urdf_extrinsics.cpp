#include "autocal_vio/calibration_io/urdf_extrinsics.h"

#include <console_bridge/console.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>
#include <vector>

#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/calibration_io/urdf_text.h"
#include "autocal_vio/geometry/so3.h"
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
  EXPECT_NE(reason.find("joint shoulder between imu and hand is revolute"), std::string::npos) << reason;
}

TEST(UrdfExtrinsics, RefusesOriginsInMillimetres) {
  std::string robot = kRobot;
  const std::string in_metres = "xyz=\"0.2 0 0\"";
  robot.replace(robot.find(in_metres), in_metres.size(), "xyz=\"200 0 0\"");
  const TemporaryFolder folder;
  const std::string reason = reasonOf(folder.write("robot.urdf", robot), "imu", "optical");
  EXPECT_NE(reason.find("optical is 200.00"), std::string::npos) << reason;
  EXPECT_NE(reason.find("millimetres"), std::string::npos) << reason;
  EXPECT_NO_THROW(urdfTransform({robot, "robot"}, "imu", "optical"));  // a base may be anywhere
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
  EXPECT_NE(reasonOf(folder.write("e.urdf", " \n"), "a", "b").find("is empty"), std::string::npos);
  const std::string xacro =
      "<robot name='r' xmlns:xacro='http://ros.org/wiki/xacro'><link name='${a}'/></robot>";
  EXPECT_NE(reasonOf(folder.write("x.urdf", xacro), "a", "b").find("expand it first"), std::string::npos);
  const std::string expanded =
      "<robot name='r' xmlns:xacro='http://ros.org/wiki/xacro'><link name='a'/></robot>";
  EXPECT_EQ(reasonOf(folder.write("y.urdf", expanded), "a", "b").find("expand it first"), std::string::npos);
  EXPECT_NE(reasonOf(folder.write("b.urdf", "<sdf/>"), "a", "b").find("expected <robot>"), std::string::npos);
  EXPECT_NE(
      reasonOf(folder.write("c.urdf", "<robot name='c'/>"), "a", "b").find("not a valid robot description"),
      std::string::npos);
}

struct Listener final : console_bridge::OutputHandler {
  void log(const std::string& text, console_bridge::LogLevel /*level*/, const char* /*file*/,
           int /*line*/) override {
    heard.push_back(text);
  }
  std::vector<std::string> heard;
};

// As a Windows editor leaves it: no line has another end than before.
TEST(UrdfExtrinsics, LinesKeepTheirEnds) {
  const std::string robot =
      "<robot name='r'>\r\n  <link name='a'/>\r\n  <link name='b'/>\r\n  <joint name='j' type='fixed'>\r\n"
      "    <parent link='a'/>\r\n    <child link='b'/>\r\n  </joint>\r\n</robot>\r\n";
  const std::string changed = urdfWithExtrinsics({robot, "robot"}, "a", "b",
                                                 Transform(Eigen::Quaterniond::Identity(), {0.1, 0.2, 0.3}))
                                  .xml;
  EXPECT_NE(changed.find("0.2"), std::string::npos);
  EXPECT_EQ(std::count(changed.begin(), changed.end(), '\n'),
            std::count(robot.begin(), robot.end(), '\n') + 1);
  EXPECT_EQ(std::count(changed.begin(), changed.end(), '\r'),
            std::count(changed.begin(), changed.end(), '\n'));
}

// What urdfdom logs is part of the refusal, and the process's own way of logging is as before.
TEST(UrdfExtrinsics, SaysWhatUrdfdomSays) {
  const TemporaryFolder folder;
  console_bridge::OutputHandler* const usual = console_bridge::getOutputHandler();
  Listener listener;
  console_bridge::useOutputHandler(&listener);
  const std::string orphan =
      reasonOf(folder.write("orphan.urdf",
                            "<robot name='r'><link name='a'/><joint name='j' type='fixed'><parent link='a'/>"
                            "<child link='c'/></joint></robot>"),
               "a", "c");
  EXPECT_NE(orphan.find("[c]"), std::string::npos) << orphan;
  const std::string number = reasonOf(
      folder.write("number.urdf",
                   "<robot name='r'><link name='a'/><link name='b'/><joint name='mount' type='fixed'>"
                   "<parent link='a'/><child link='b'/><origin xyz='1 2 x'/></joint></robot>"),
      "a", "b");
  EXPECT_NE(number.find("mount"), std::string::npos) << number;
  EXPECT_TRUE(listener.heard.empty());
  EXPECT_EQ(console_bridge::getOutputHandler(), &listener);
  CONSOLE_BRIDGE_logError("of another matter");
  EXPECT_EQ(listener.heard.size(), 1u);
  // Whoever restores "the handler before" finds one that lives.
  console_bridge::restorePreviousOutputHandler();
  CONSOLE_BRIDGE_logError("after it");
  EXPECT_EQ(listener.heard.size(), 2u);
  for (int i = 0; i < 2; ++i) console_bridge::useOutputHandler(usual);
  std::printf("%s\n%s\n", orphan.c_str(), number.c_str());
}

double distance(const Transform& a, const Transform& b) {
  return ((a.inverse() * b).matrix() - Eigen::Matrix4d::Identity()).norm();
}

// The lines of `changed` that differ from those of `original`; "*" where their number differs.
std::vector<std::string> changedLines(const std::string& original, const std::string& changed) {
  std::istringstream a(original), b(changed);
  std::vector<std::string> lines;
  std::string line_a, line_b;
  while (std::getline(a, line_a) && std::getline(b, line_b)) {
    if (line_a != line_b) lines.push_back(line_b);
  }
  if (std::count(original.begin(), original.end(), '\n') != std::count(changed.begin(), changed.end(), '\n'))
    lines.push_back("*");
  return lines;
}

TEST(UrdfExtrinsics, KnowsItsLinks) {
  EXPECT_TRUE(urdfHasLink({kRobot, "robot"}, "optical"));
  EXPECT_FALSE(urdfHasLink({kRobot, "robot"}, "optical2"));
  EXPECT_FALSE(urdfHasLink({"<robot", "robot"}, "optical"));
}

// The mount's joint is changed, not the one that turns to the optical frame.
TEST(UrdfWriting, ChangesTheOriginOfTheCamerasJointAlone) {
  const Transform T_imu_cam(expSo3(Eigen::Vector3d(0.3, -1.2, 2.0)), Eigen::Vector3d(0.1, -0.2, 0.05));
  const std::string written = urdfWithExtrinsics({kRobot, "robot"}, "imu", "optical", T_imu_cam).xml;
  EXPECT_LT(distance(urdfTransform({written, "written"}, "imu", "optical"), T_imu_cam), 1e-10);
  const std::vector<std::string> lines = changedLines(kRobot, written);
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(urdfWithExtrinsics({kRobot, "robot"}, "imu", "optical", T_imu_cam).joint, "camera_joint");
  EXPECT_EQ(lines[0].rfind("    <parent link=\"mast\"/> <child link=\"camera\"/> <origin xyz=\"", 0), 0u)
      << lines[0];
  // The other links have not moved.
  EXPECT_LT(distance(urdfTransform({written, "written"}, "base", "mast"),
                     urdfTransform({kRobot, "robot"}, "base", "mast")),
            1e-15);
  // And back again.
  const Transform before = urdfTransform({kRobot, "robot"}, "imu", "optical");
  const std::string back = urdfWithExtrinsics({written, "written"}, "imu", "optical", before).xml;
  EXPECT_LT(distance(urdfTransform({back, "back"}, "imu", "optical"), before), 1e-10);
}

TEST(UrdfWriting, LooksStraightDown) {  // where yaw and roll of the joint turn about the same axis
  const Transform T_imu_cam(expSo3(Eigen::Vector3d(0.0, M_PI / 2, 0.0)), Eigen::Vector3d(0.1, 0.0, 0.0));
  for (const char* camera : {"optical", "camera", "mast"}) {
    const std::string written = urdfWithExtrinsics({kRobot, "robot"}, "imu", camera, T_imu_cam).xml;
    EXPECT_LT(distance(urdfTransform({written, "written"}, "imu", camera), T_imu_cam), 1e-10) << camera;
  }
}

TEST(UrdfWriting, AnOpticalJointWithNothingAboveItIsTheCamerasJoint) {
  const char* const robot = R"(<robot name='a'><link name='imu'/><link name='optical'/>
<joint name='mount' type='fixed'><parent link='imu'/><child link='optical'/>
<origin rpy='-1.5707963267948966 0 -1.5707963267948966'/></joint></robot>)";
  const Transform T_imu_cam(expSo3(Eigen::Vector3d(0.1, 0.2, 0.3)), Eigen::Vector3d(1.0, 2.0, 3.0));
  const std::string written = urdfWithExtrinsics({robot, "robot"}, "imu", "optical", T_imu_cam).xml;
  EXPECT_LT(distance(urdfTransform({written, "written"}, "imu", "optical"), T_imu_cam), 1e-10);
}

TEST(UrdfWriting, RefusesWhatItCannotDo) {
  const auto reason = [](const char* imu, const char* camera) -> std::string {
    try {
      urdfWithExtrinsics({kRobot, "robot"}, imu, camera, Transform());
    } catch (const LoadProblems& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(reason("imu", "hand").find("joint shoulder"), std::string::npos);
  EXPECT_NE(reason("optical", "mast").find("link mast carries optical"), std::string::npos);
  EXPECT_NE(reason("imu", "imu").find("carries"), std::string::npos);
  EXPECT_NE(reason("imu", "nothing").find("no link nothing"), std::string::npos);
}

const Transform kOrigin(Eigen::Quaterniond::Identity(), Eigen::Vector3d(1.0, -0.0, 0.25));

TEST(UrdfText, KeepsCommentsQuotesAndFormatting) {
  const std::string head = R"(<?xml version="1.0"?>
<!DOCTYPE robot>
<!-- <joint name="j"><origin xyz="9 9 9"/></joint> -->
<robot name="a > b">
  <transmission name="t"><joint name="j"><origin xyz="8 8 8"/></joint></transmission>
  <![CDATA[<joint name="j"><origin/></joint>]]>
  <joint  type = 'fixed'
          name = 'j'>   <!-- <origin xyz="7 7 7"/> -->
    <child link="x"><origin xyz="6 6 6"/></child>
)";
  const std::string tail = R"(
  </joint>	<joint name="k"><origin xyz="5 5 5"/></joint>
</robot>
)";
  const auto changed = [&](const std::string& origin) {
    return replaceJointOrigin(head + origin + tail, "j", kOrigin).value_or("");
  };
  EXPECT_EQ(changed("<origin  xyz='0 0\n0' \t rpy = \"1 2 3\" />"),
            head + "<origin  xyz='1 0 0.25' \t rpy = \"0 0 0\" />" + tail);
  EXPECT_EQ(changed("<origin rpy=\"1 2 3\" xyz=\"1 2 3\"></origin>"),
            head + "<origin rpy=\"0 0 0\" xyz=\"1 0 0.25\"></origin>" + tail);
  EXPECT_EQ(changed("<origin rpy=\"1 2 3\"/>"), head + "<origin xyz=\"1 0 0.25\" rpy=\"0 0 0\"/>" + tail);
  EXPECT_EQ(changed("<origin/>"), head + "<origin xyz=\"1 0 0.25\" rpy=\"0 0 0\"/>" + tail);
}

TEST(UrdfText, WritesAnOriginThatIsNotThere) {
  const std::string text = "<robot>\n  <joint name=\"j\">\n    <parent link=\"a\"/>\n  </joint>\n</robot>\n";
  EXPECT_EQ(replaceJointOrigin(text, "j", kOrigin).value_or(""),
            "<robot>\n  <joint name=\"j\">\n    <origin xyz=\"1 0 0.25\" rpy=\"0 0 0\"/>\n    <parent "
            "link=\"a\"/>\n  </joint>\n</robot>\n");
  EXPECT_FALSE(replaceJointOrigin(text, "jj", kOrigin));
  EXPECT_FALSE(replaceJointOrigin("", "j", kOrigin));
  EXPECT_FALSE(replaceJointOrigin("<robot><joint name='j'", "j", kOrigin));
}

}  // namespace
}  // namespace autocal_vio
