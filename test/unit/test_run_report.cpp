#include "autocal_vio/tools/run_report.h"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <iterator>
#include <sstream>

#include "autocal_vio/tools/result_tables.h"
#include "example_run.h"

namespace autocal_vio {
namespace {

std::vector<std::string> linesOf(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

TEST(ResultTables, StampsKeepEveryNanosecond) {
  EXPECT_EQ(stampText(1403638538577829376), "1403638538.577829376");
  EXPECT_EQ(stampText(1000000000000000005), "1000000000.000000005");
}

TEST(ResultTables, OdometryBeginsWithTheFirstEstimate) {
  const std::vector<std::string> lines = linesOf(odometryTumText(exampleRun(101).rows()));
  ASSERT_EQ(lines.size(), 21u);  // 4 s to 5 s
  EXPECT_EQ(lines[0].rfind(
                "1403638542.577829376 4.000000 -2.000000 0.001000 0.000000000 0.000000000 0.19866933", 0),
            0u)
      << lines[0];
  std::istringstream fields(lines[0]);
  std::vector<double> values{std::istream_iterator<double>(fields), {}};
  EXPECT_EQ(values.size(), 8u);
}

TEST(ResultTables, ExtrinsicsHaveALinePerImage) {
  const std::vector<std::string> lines = linesOf(extrinsicsCsvText(exampleRun(301).rows()));
  ASSERT_EQ(lines.size(), 302u);
  EXPECT_EQ(
      lines[0],
      "stamp_s,px,py,pz,qx,qy,qz,qw,sigma_px,sigma_py,sigma_pz,sigma_rx,sigma_ry,sigma_rz,td,sigma_td,state");
  for (std::size_t i : {1u, 100u, 301u})
    EXPECT_EQ(std::count(lines[i].begin(), lines[i].end(), ','), 16) << lines[i];
  EXPECT_EQ(lines[1].substr(lines[1].rfind(',')), ",calibrating_rotation");
  EXPECT_EQ(lines[301].substr(lines[301].rfind(',')), ",converged");
}

TEST(TimingStatistics, NearestRank) {
  std::vector<double> values;
  for (int i = 1; i <= 200; ++i) values.push_back(201 - i);
  const TimingSummary summary = summarize(values);
  EXPECT_EQ(summary.median, 100.0);
  EXPECT_EQ(summary.p95, 190.0);
  EXPECT_EQ(summary.p99, 198.0);
  EXPECT_EQ(summary.max, 200.0);
  EXPECT_EQ(summary.count, 200u);
  EXPECT_EQ(summarize({}).max, 0.0);
  EXPECT_EQ(summarize({3.0}).median, 3.0);
  EXPECT_GT(peakMemoryMb(), 1.0);
  EXPECT_LT(peakMemoryMb(), 1e5);
}

TEST(Verdict, NeedsConvergenceOrWithFixedExtrinsicsOdometryToTheEnd) {
  EXPECT_TRUE(judgeRun(exampleRun(300), false).success);
  EXPECT_EQ(judgeRun(exampleRun(300), false).name, "converged");
  EXPECT_FALSE(judgeRun(exampleRun(150), false).success);
  EXPECT_EQ(judgeRun(exampleRun(150), false).name, "not_converged");
  EXPECT_TRUE(judgeRun(exampleRun(150), true).success);
  EXPECT_EQ(judgeRun(exampleRun(150), true).name, "odometry_complete");
  EXPECT_FALSE(judgeRun(exampleRun(20), true).success);
  EXPECT_FALSE(judgeRun(RunRecord(), false).success);
  RunRecord lost = exampleRun(300);
  VioUpdate update = exampleUpdate(300);
  update.state = VioState::kLost;
  update.reason = "covered \"lens\"";
  lost.add(update);
  EXPECT_FALSE(judgeRun(lost, false).success);
  EXPECT_FALSE(judgeRun(lost, true).success);
  EXPECT_EQ(judgeRun(lost, true).reason, "lost: covered \"lens\"");
}

TEST(Verdict, OdometryIsCompleteOnlyWithTheLastImageProcessed) {
  RunRecord record = exampleRun(150);
  const TimeNs last = record.rows().back().stamp;
  record.noteOffered(last + kNsPerSecond);
  EXPECT_TRUE(judgeRun(record, true).success) << "recordings end with an image or two too many";
  record.noteOffered(last + 5 * kNsPerSecond);
  EXPECT_FALSE(judgeRun(record, true).success);
  EXPECT_EQ(judgeRun(record, true).name, "odometry_incomplete");
  EXPECT_NE(judgeRun(record, true).reason.find("the images of the last 5.0 s were not processed"),
            std::string::npos)
      << judgeRun(record, true).reason;
  RunRecord converged = exampleRun(300);
  converged.noteOffered(converged.rows().back().stamp + 5 * kNsPerSecond);
  EXPECT_TRUE(judgeRun(converged, false).success);
  EXPECT_NE(judgeRun(converged, false).reason.find("5.0 s"), std::string::npos);
}

TEST(Verdict, SaysThatTheInputEndedEarly) {
  const std::string damage = "x.bag: /imu0: cannot be read after the message of 12.500000000 s: broken";
  for (const int images : {0, 150, 300}) {
    RunRecord record = exampleRun(images);
    record.noteDamage(damage);
    for (const bool fixed : {false, true}) {
      const Verdict verdict = judgeRun(record, fixed);
      EXPECT_FALSE(verdict.success);
      EXPECT_NE(verdict.reason.find("the input ended early: " + damage), std::string::npos) << verdict.reason;
      EXPECT_EQ(verdict.name, fixed           ? "odometry_incomplete"
                              : images == 300 ? "input_incomplete"
                                              : "not_converged");
    }
  }
}

TEST(RunReport, LeavesOutCountsThatAreNotKnown) {
  const RunRecord record = exampleRun(10);
  RunCounts counts;
  YAML::Node report = YAML::Load(runReportText(record, judgeRun(record, false), counts, {}, std::nullopt));
  EXPECT_FALSE(report["imu_samples"]);
  EXPECT_FALSE(report["images_uncovered"]);
  counts.imu_samples = 1000;
  counts.images_uncovered = 7;
  report = YAML::Load(runReportText(record, judgeRun(record, false), counts, {}, std::nullopt));
  EXPECT_EQ(report["imu_samples"].as<int>(), 1000);
  EXPECT_EQ(report["images_uncovered"].as<int>(), 7);
}

TEST(RunReport, HasTheKeysOfTheContract) {
  const RunRecord record = exampleRun(301);
  RunCounts counts;
  counts.images_processed = 301;
  counts.images_dropped = 2;
  RunTimings timings;
  timings.cpu_seconds = 4.5;
  timings.peak_memory_mb = 123.4;
  timings.image_ms = {10.0, 20.0, 30.0};
  const Transform truth(Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2.0, Eigen::Vector3d::UnitZ())),
                        Eigen::Vector3d(0.1, -0.06, 0.02));
  const YAML::Node report =
      YAML::Load(runReportText(record, judgeRun(record, false), counts, timings, truth));
  EXPECT_EQ(report["verdict"].as<std::string>(), "converged");
  EXPECT_EQ(report["images_processed"].as<int>(), 301);
  EXPECT_EQ(report["images_dropped"].as<int>(), 2);
  EXPECT_EQ(report["cpu_seconds"].as<double>(), 4.5);
  EXPECT_EQ(report["peak_memory_mb"].as<double>(), 123.4);
  EXPECT_EQ(report["ms_per_image"]["median"].as<double>(), 20.0);
  EXPECT_EQ(report["tracking"]["max"].as<double>(), 5.0);
  EXPECT_EQ(report["initialization"]["images"].as<int>(), 0);
  EXPECT_NEAR(report["optimization"]["max"].as<double>(), 13.0, 1e-9);
  EXPECT_EQ(report["first_odometry_seconds"].as<double>(), 4.0);
  ASSERT_EQ(report["state_changes"].size(), 4u);
  EXPECT_EQ(report["state_changes"][3]["state"].as<std::string>(), "converged");
  EXPECT_EQ(report["state_changes"][3]["seconds"].as<double>(), 12.0);
  const Transform last = record.rows().back().calibration.T_imu_cam;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      EXPECT_NEAR(report["T_imu_cam"][row][column].as<double>(), last.matrix()(row, column), 1e-8);
      EXPECT_NEAR(report["T_cam_imu"][row][column].as<double>(), last.inverse().matrix()(row, column), 1e-8);
    }
  }
  EXPECT_LT(report["reference"]["translation_error_m"].as<double>(), 0.01);
}

TEST(RunReport, ResultPartDoesNotDependOnTheTimings) {
  const RunRecord record = exampleRun(301);
  RunTimings slow, fast;
  slow.cpu_seconds = 99.0;
  const std::string a = runReportText(record, judgeRun(record, false), {}, slow, std::nullopt);
  const std::string b = runReportText(record, judgeRun(record, false), {}, fast, std::nullopt);
  const std::size_t divide = a.find("# --- run time");
  ASSERT_NE(divide, std::string::npos);
  EXPECT_EQ(a.substr(0, divide), b.substr(0, divide));
  EXPECT_NE(a, b);
}

TEST(RunReport, IsValidWithoutASingleImage) {
  const RunRecord record;
  const YAML::Node report = YAML::Load(runReportText(record, judgeRun(record, false), {}, {}, std::nullopt));
  EXPECT_EQ(report["verdict"].as<std::string>(), "not_converged");
  EXPECT_TRUE(report["first_odometry_seconds"].IsNull());
}

}  // namespace
}  // namespace autocal_vio
