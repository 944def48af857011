#include "autocal_vio/tools/convergence_plot.h"

#include <gtest/gtest.h>

#include <limits>
#include <opencv2/imgproc.hpp>

#include "autocal_vio/tools/line_chart.h"
#include "example_run.h"

namespace autocal_vio {
namespace {

const cv::Scalar kColour(200, 0, 0);

int countColour(const cv::Mat& image, const cv::Rect& area, const cv::Scalar& colour) {
  cv::Mat mask;
  cv::inRange(image(area), colour, colour, mask);
  return cv::countNonZero(mask);
}

TEST(LineChart, TicksAreRoundAndInside) {
  EXPECT_EQ(LineChart::ticks({0.0, 10.0}, 5), (std::vector<double>{0, 2, 4, 6, 8, 10}));
  EXPECT_EQ(LineChart::ticks({-0.35, 0.35}, 3).size(), 1u);  // step 0.5
  for (double tick : LineChart::ticks({-1.03, 17.9}, 6)) {
    EXPECT_GE(tick, -1.03);
    EXPECT_LE(tick, 17.9);
  }
  EXPECT_TRUE(LineChart::ticks({1.0, 1.0}, 5).empty());
}

TEST(LineChart, RangeIgnoresTheFirstGuessesButHoldsTheTruth) {
  LineChart chart("title", "m");
  ChartSeries series{"", kColour, {}, {}, {}, {{0.0, 3.0}}};
  for (int i = 0; i < 90; ++i) {
    series.time.push_back(i);
    series.value.push_back(i < 20 ? 1e6 : 2.0);
    series.sigma.push_back(0.1);
  }
  chart.add(series);
  const ChartRange range = chart.valueRange();
  EXPECT_LT(range.low, 1.7);
  EXPECT_GT(range.low, 1.0);
  EXPECT_GT(range.high, 3.0);
  EXPECT_LT(range.high, 3.5);
}

TEST(LineChart, DrawsTheCurveWhereItBelongs) {
  LineChart chart("title", "m");
  chart.setTimeRange({0.0, 1.0});
  ChartSeries series{"", kColour, {0.0, 0.25, 0.5, 0.75, 1.0}, {0.0, 0.25, 0.5, 0.75, 1.0}, {}};
  chart.add(series);
  cv::Mat image(400, 600, CV_8UC3, cv::Scalar::all(255));
  chart.draw(&image, {0, 0, 600, 400});
  // A rising line: only the lower left and the upper right quarter of the frame have it.
  const cv::Rect frame(78, 30, 504, 334);
  const cv::Size half(frame.width / 2 - 20, frame.height / 2 - 20);
  EXPECT_GT(countColour(image, {{frame.x, frame.y + frame.height - half.height}, half}, kColour), 50);
  EXPECT_GT(countColour(image, {{frame.x + frame.width - half.width, frame.y}, half}, kColour), 50);
  EXPECT_EQ(countColour(image, {frame.tl(), half}, kColour), 0);
}

// A truth that walks is not its last value all along.
TEST(LineChart, DrawsATruthThatChangesWhereItBelongs) {
  LineChart chart("title", "m");
  chart.setTimeRange({0.0, 1.0});
  chart.add({"", cv::Scalar(0, 0, 400), {}, {}, {}, {{0.3, 0.0}, {0.7, 1.0}}});
  cv::Mat image(400, 600, CV_8UC3, cv::Scalar::all(255)), red;
  chart.draw(&image, {0, 0, 600, 400});
  cv::inRange(image, cv::Scalar(0, 0, 150), cv::Scalar(140, 140, 255), red);
  const cv::Rect frame(78, 30, 504, 334);
  const cv::Size quarter(frame.width / 4, frame.height / 4);
  EXPECT_GT(cv::countNonZero(red({{frame.x, frame.y + frame.height - quarter.height}, quarter})), 20);
  EXPECT_GT(cv::countNonZero(red({{frame.x + frame.width - quarter.width, frame.y}, quarter})), 20);
  EXPECT_EQ(cv::countNonZero(red({frame.tl(), quarter})), 0);
}

TEST(LineChart, TextsOfATinyRangeFitBesideTheFrame) {
  for (double value : {0.0, -0.012, 1234.5, -123.4}) {
    LineChart chart("title", "m");
    chart.add({"", kColour, {0.0, 0.5, 1.0}, {value, value + 1e-9, value}, {}});
    cv::Mat image(400, 600, CV_8UC3, cv::Scalar::all(255));
    chart.draw(&image, {0, 0, 600, 400});
    EXPECT_EQ(cv::mean(image.colRange(0, 2)), cv::Scalar(255, 255, 255, 0)) << value;
  }
}

TEST(LineChart, SurvivesGapsInfinitiesAndNothing) {
  cv::Mat image(400, 600, CV_8UC3, cv::Scalar::all(255));
  LineChart("empty", "").draw(&image, {0, 0, 600, 400});
  LineChart chart("title", "m");
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  chart.add({"a", kColour, {0, 1, 2, 3, 4}, {nan, 1.0, 1e300, -inf, 2.0}, {1, 1, inf, nan, 1}, {{0.0, 1.0}}});
  chart.draw(&image, {0, 0, 600, 400});
  chart.add({"b", kColour, {0, 1}, {nan, nan}, {nan, nan}});
  chart.draw(&image, {0, 0, 600, 400});
  EXPECT_LT(cv::mean(image)[0], 255.0);
}

TEST(ConvergencePlot, SameRunSamePicture) {
  const RunRecord record = exampleRun(400);
  const PlotTruth truth{record.rows().back().calibration.T_imu_cam, 0.005, {}, {}};
  const cv::Mat a = drawConvergence(record, truth, "title"), b = drawConvergence(record, truth, "title");
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(cv::norm(a, b, cv::NORM_INF), 0.0);
  EXPECT_GT(cv::norm(a, drawConvergence(exampleRun(200), truth, "title"), cv::NORM_INF), 0.0);
  EXPECT_EQ(drawConvergence(RunRecord(), {}, "nothing").size(), a.size());
}

TEST(ConvergencePlot, WhatIsKnownToBeTrueIsDrawn) {
  const RunRecord record = exampleRun(100);
  const CalibrationEstimate& last = record.rows().back().calibration;
  PlotTruth truth;
  cv::Mat before = drawConvergence(record, truth, "title");
  const auto changes = [&] {
    const cv::Mat image = drawConvergence(record, truth, "title");
    const bool changed = cv::norm(before, image, cv::NORM_INF) > 0.0;
    before = image;
    return changed;
  };
  truth.T_imu_cam = last.T_imu_cam;
  EXPECT_TRUE(changes());
  truth.td = 0.005;
  EXPECT_TRUE(changes());
  truth.gyroscope_biases = {{0, last.gyroscope_bias}};
  EXPECT_TRUE(changes());
  truth.accelerometer_biases = {{0, last.accelerometer_bias}};
  EXPECT_TRUE(changes());
}

}  // namespace
}  // namespace autocal_vio
