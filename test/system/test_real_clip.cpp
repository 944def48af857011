// The whole chain on recorded flights; skipped where the data is not at hand.
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "figure_table.h"
#include "recorded_run.h"

namespace autocal_vio {
namespace {

class RealClip : public ::testing::Test {
 protected:
  /// Path of mav0/ of a sequence; empty, and the test skipped, where it is missing.
  static std::string sequence(const std::string& name) {
    const std::filesystem::path path = recordedData() / "euroc" / name / "mav0";
    return std::filesystem::is_directory(path / "cam0") ? path.string() : std::string();
  }
};

TEST_F(RealClip, FlightFromNothing) {
  const std::string mav0 = sequence("MH_05_difficult");
  if (mav0.empty()) GTEST_SKIP() << "no recorded data in " << recordedData() << " (set AUTOCAL_VIO_DATA)";
  const RecordedOutcome outcome = runRecorded(mav0, false);
  EXPECT_LT(outcome.first_odometry_s, 2.0 + 6.0);  // it stands nearly still for the first 2 s
  EXPECT_LT(outcome.rotation_deg, 0.4);
  EXPECT_LT(outcome.translation_m, 0.04);
  EXPECT_LT(outcome.error_in_sigmas, 3.0);
  EXPECT_LT(outcome.ate_m, 0.12);
  EXPECT_LT(outcome.largest_gap_s, 0.1);
  EXPECT_EQ(outcome.result.counts.images_dropped, 0U);
}

TEST_F(RealClip, FlightWithTheTrueExtrinsicsAsPrior) {
  const std::string mav0 = sequence("MH_05_difficult");
  if (mav0.empty()) GTEST_SKIP() << "no recorded data in " << recordedData() << " (set AUTOCAL_VIO_DATA)";
  const RecordedOutcome outcome = runRecorded(mav0, true);
  EXPECT_LT(outcome.first_odometry_s, 2.1);
  EXPECT_LT(outcome.ate_m, 0.10);
  EXPECT_LT(outcome.rotation_deg, 0.35);
  EXPECT_LT(outcome.translation_m, 0.025);
  EXPECT_LT(outcome.error_in_sigmas, 3.0);
  EXPECT_LT(outcome.largest_gap_s, 0.1);
}

// In flight. The flow from an image of before finds look-alikes: followed, they were taken for the rig's motion, metres off.
TEST_F(RealClip, SecondsWithoutImagesAreBridged) {
  const std::string mav0 = sequence("MH_05_difficult");
  if (mav0.empty()) GTEST_SKIP() << "no recorded data in " << recordedData() << " (set AUTOCAL_VIO_DATA)";
  const std::vector<double> begins{18.0, 10.0, 12.0, 14.0, 16.0, 20.0};  // AUTOCAL_VIO_SEEDS=6: all of them
  for (int place = 0; place < std::min(seeds(1), static_cast<int>(begins.size())); ++place) {
    for (const double length : {3.0, 2.0, 1.5}) {
      if (length < 2.0 && seeds(1) == 1) continue;
      const double begin = begins[static_cast<std::size_t>(place)];
      SCOPED_TRACE(std::to_string(length) + " s from " + std::to_string(begin) + " s on");
      const RecordedOutcome outcome = runRecorded(mav0, false, {begin, begin + length, {}});
      EXPECT_LT(outcome.ate_m, 0.2);
      EXPECT_LT(outcome.largest_gap_s, length + 0.1);
      EXPECT_LT(outcome.error_in_sigmas, 3.0);
      for (const RunRow& row : outcome.result.record.rows()) EXPECT_NE(row.state, VioState::kLost);
    }
  }
}

// From nothing, whatever comes over the images: odometry without a gap, and extrinsics that are right.
void expectFlown(const RecordedOutcome& outcome, double first_odometry_s, double ate_m) {
  EXPECT_LT(outcome.first_odometry_s, first_odometry_s);
  EXPECT_LT(outcome.ate_m, ate_m);
  EXPECT_LT(outcome.largest_gap_s, 0.1);
  EXPECT_LT(outcome.error_in_sigmas, 3.0);
}

// As a camera on a bad cable sends them. Each lost all tracks, and odometry never began.
TEST_F(RealClip, ABlackImageEveryTwoSecondsCostsOnlyItself) {
  const std::string mav0 = sequence("MH_05_difficult");
  if (mav0.empty()) GTEST_SKIP() << "no recorded data in " << recordedData() << " (set AUTOCAL_VIO_DATA)";
  ImageFaults faults;
  faults.paint = [](double time, cv::Mat* image) {
    if (std::lround(20.0 * time) % 40 == 20) image->setTo(0);
  };
  expectFlown(runRecorded(mav0, false, faults), 2.0 + 6.0, 0.12);
}

// More contrast than the dim hall has: most corners are found there. Odometry never began.
TEST_F(RealClip, APartOfTheRobotInTheImageIsLeftOut) {
  const std::string mav0 = sequence("MH_05_difficult");
  if (mav0.empty()) GTEST_SKIP() << "no recorded data in " << recordedData() << " (set AUTOCAL_VIO_DATA)";
  cv::Mat part(120, 752, CV_8UC1);  // a quarter of the image
  cv::RNG random(1);
  random.fill(part, cv::RNG::NORMAL, 128, 90);
  cv::GaussianBlur(part, part, cv::Size(), 3.0);
  cv::normalize(part, part, 10, 240, cv::NORM_MINMAX);
  ImageFaults faults;
  faults.paint = [&](double, cv::Mat* image) {
    cv::Mat noise(part.size(), CV_8UC1);
    random.fill(noise, cv::RNG::NORMAL, 3.0, 1.5);
    cv::add(part, noise, image->rowRange(360, 480));
  };
  expectFlown(runRecorded(mav0, false, faults), 2.0 + 8.0, 0.2);
}

// As a stream of video does that has lost packets: other noise, else the same image. One a second; it was called a
// moved mount, and the estimate ended 0.9 m and 8 sigmas off.
TEST_F(RealClip, ImagesThatComeTwiceNeedNotBeTheSameBytes) {
  const std::string mav0 = sequence("MH_05_difficult");
  if (mav0.empty()) GTEST_SKIP() << "no recorded data in " << recordedData() << " (set AUTOCAL_VIO_DATA)";
  cv::Mat last, noise(480, 752, CV_16SC1);
  cv::RNG random(1);
  ImageFaults faults;
  faults.paint = [&](double time, cv::Mat* image) {
    if (std::lround(20.0 * time) % 20 == 10 && !last.empty()) {
      random.fill(noise, cv::RNG::NORMAL, 0.0, 1.0);
      cv::add(last, noise, *image, cv::noArray(), CV_8U);
    }
    last = image->clone();
  };
  expectFlown(runRecorded(mav0, false, faults), 2.0 + 6.0, 0.12);
}

TEST_F(RealClip, StandstillClaimsNothing) {
  const std::string mav0 = sequence("V1_01_easy");
  if (mav0.empty()) GTEST_SKIP() << "no recorded data in " << recordedData() << " (set AUTOCAL_VIO_DATA)";
  const RecordedOutcome outcome = runRecorded(mav0, false);
  EXPECT_FALSE(std::isfinite(outcome.first_odometry_s));
  for (const RunRow& row : outcome.result.record.rows())
    EXPECT_TRUE(row.state == VioState::kWaitingForData || row.state == VioState::kCalibratingRotation);
  EXPECT_NE(outcome.result.record.lastAdvice().find("rotate"), std::string::npos)
      << outcome.result.record.lastAdvice();
}

}  // namespace
}  // namespace autocal_vio
