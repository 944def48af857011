#include "autocal_vio/tools/convergence_plot.h"

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "autocal_vio/common/angle.h"
#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/tools/line_chart.h"

namespace autocal_vio {
namespace {

constexpr int kColumns = 3, kRows = 4, kPanelWidth = 620, kPanelHeight = 320, kHeader = 70;
constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

const cv::Scalar kBlue(180, 90, 20), kRed(50, 50, 200), kGreen(60, 140, 30), kViolet(160, 60, 140);  // BGR
const cv::Scalar kStarted(0, 165, 255), kConvergedColour(80, 180, 60), kLostColour(60, 60, 230);

// Value and sigma of one quantity; not finite where it is unknown.
struct Point {
  double value = kNothing;
  double sigma = kNothing;
};

using Quantity = std::function<Point(const CalibrationEstimate&)>;

// Yaw, pitch and roll of R_imu_cam [deg] with their sigmas, carried over from the rotation's right
// perturbation.
std::array<Point, 3> yawPitchRollPoints(const CalibrationEstimate& calibration) {
  std::array<Point, 3> points;
  if (!rotationKnown(calibration)) return points;
  const Eigen::Quaterniond& q = calibration.T_imu_cam.rotation;
  const Eigen::Vector3d angles = yawPitchRoll(q);
  constexpr double kStep = 1e-6;
  Eigen::Matrix3d J;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d forward = yawPitchRoll(q * expSo3((kStep * Eigen::Vector3d::Unit(axis)).eval()));
    for (int i = 0; i < 3; ++i) J(i, axis) = std::remainder(forward(i) - angles(i), 2.0 * M_PI) / kStep;
  }
  const Eigen::Matrix3d covariance = J * calibration.covariance.bottomRightCorner<3, 3>() * J.transpose();
  for (int i = 0; i < 3; ++i) points[i] = {angles(i) / kDegree, std::sqrt(covariance(i, i)) / kDegree};
  return points;
}

std::vector<cv::Point2d> level(double value) {
  return {{0.0, value}};
}

Point knownPoint(double value, double sigma, double largest_sigma) {
  if (!(sigma < largest_sigma)) return {};
  return {value, sigma};
}

class ConvergencePlot {
 public:
  ConvergencePlot(const RunRecord& record, const PlotTruth& truth) : record_(record), truth_(truth) {
    image_ = cv::Mat(kHeader + kRows * kPanelHeight, kColumns * kPanelWidth, CV_8UC3, cv::Scalar::all(255));
    if (!record.rows().empty()) duration_ = std::max(1.0, seconds(record.rows().back().stamp));
  }

  cv::Mat draw(const std::string& title) {
    drawHeader(title);
    drawRotation();
    drawTranslation();
    drawTimeOffset();
    drawBiases();
    drawVisualScale();
    drawGravity();
    drawSingularValues();
    return image_;
  }

 private:
  double seconds(TimeNs stamp) const {
    return record_.rows().empty() ? 0.0 : toSeconds(stamp - record_.rows().front().stamp);
  }

  ChartSeries series(const std::string& label, const cv::Scalar& colour, const Quantity& quantity,
                     bool with_band = true) const {
    ChartSeries result{label, colour, {}, {}, {}};
    for (const RunRow& row : record_.rows()) {
      const Point point = quantity(row.calibration);
      result.time.push_back(seconds(row.stamp));
      result.value.push_back(point.value);
      if (with_band) result.sigma.push_back(point.sigma);
    }
    return result;
  }

  void drawPanel(LineChart chart) {
    chart.setTimeRange({0.0, duration_});
    for (const StateChange& change : record_.stateChanges()) {
      if (change.state == VioState::kEstimating) chart.add(ChartMarker{seconds(change.stamp), kStarted});
      if (change.state == VioState::kConverged)
        chart.add(ChartMarker{seconds(change.stamp), kConvergedColour});
      if (change.state == VioState::kLost) chart.add(ChartMarker{seconds(change.stamp), kLostColour});
    }
    const cv::Rect area(panel_ % kColumns * kPanelWidth, kHeader + panel_ / kColumns * kPanelHeight,
                        kPanelWidth, kPanelHeight);
    chart.draw(&image_, area);
    ++panel_;
  }

  void drawHeader(const std::string& title) {
    const cv::Scalar ink(40, 40, 40);
    cv::putText(image_, title, {24, 30}, cv::FONT_HERSHEY_SIMPLEX, 0.75, ink, 1, cv::LINE_AA);
    const std::array<std::pair<const char*, cv::Scalar>, 3> marks{
        {{"estimating", kStarted}, {"converged", kConvergedColour}, {"lost", kLostColour}}};
    int x = 24;
    for (const auto& [name, colour] : marks) {
      cv::line(image_, {x, 46}, {x, 62}, colour, 2);
      cv::putText(image_, name, {x + 8, 59}, cv::FONT_HERSHEY_SIMPLEX, 0.5, ink, 1, cv::LINE_AA);
      x += 120;
    }
    cv::putText(image_, "shaded: 3 sigma    dashed: reference    time since the first image [s]", {x, 59},
                cv::FONT_HERSHEY_SIMPLEX, 0.5, ink, 1, cv::LINE_AA);
  }

  void drawRotation() {
    const char* const names[] = {"Yaw of R_imu_cam", "Pitch of R_imu_cam", "Roll of R_imu_cam"};
    for (int i = 0; i < 3; ++i) {
      ChartSeries curve =
          series("", kBlue, [i](const CalibrationEstimate& c) { return yawPitchRollPoints(c)[i]; });
      // Continuous through +-180 deg, ending within it; the truth on the same turn.
      double reference = kNothing;
      for (std::size_t k = curve.value.size(); k-- > 0;) {
        if (!std::isfinite(curve.value[k])) continue;
        if (std::isfinite(reference))
          curve.value[k] = reference + std::remainder(curve.value[k] - reference, 360.0);
        reference = curve.value[k];
      }
      if (truth_.T_imu_cam) curve.truth = level(truthAngle(i, curve));
      LineChart chart(names[i], "deg");
      chart.add(curve);
      drawPanel(chart);
    }
  }

  double truthAngle(int i, const ChartSeries& curve) const {
    const double angle = yawPitchRoll(truth_.T_imu_cam->rotation)(i) / kDegree;
    const double last =
        curve.value.empty() || !std::isfinite(curve.value.back()) ? angle : curve.value.back();
    return last + std::remainder(angle - last, 360.0);
  }

  void drawTranslation() {
    const char* const names[] = {"x of p_imu_cam", "y of p_imu_cam", "z of p_imu_cam"};
    for (int i = 0; i < 3; ++i) {
      ChartSeries curve = series("", kBlue, [i](const CalibrationEstimate& c) {
        if (!extrinsicsKnown(c)) return Point();
        return Point{c.T_imu_cam.translation(i), std::sqrt(c.covariance(i, i))};
      });
      if (truth_.T_imu_cam) curve.truth = level(truth_.T_imu_cam->translation(i));
      LineChart chart(names[i], "m");
      chart.add(curve);
      drawPanel(chart);
    }
  }

  void drawTimeOffset() {
    ChartSeries curve = series("", kBlue, [](const CalibrationEstimate& c) {
      return knownPoint(1e3 * c.td, 1e3 * c.sigma_td, 1e3);
    });
    if (truth_.td) curve.truth = level(1e3 * *truth_.td);
    LineChart chart("Time offset td", "ms");
    chart.add(curve);
    drawPanel(chart);
  }

  void drawVector(const std::string& title, const std::string& unit,
                  const std::function<Point(const CalibrationEstimate&, int)>& at,
                  const std::vector<TrueBias>& truth) {
    const std::array<std::pair<const char*, cv::Scalar>, 3> axes{{{"x", kRed}, {"y", kGreen}, {"z", kBlue}}};
    LineChart chart(title, unit);
    for (int i = 0; i < 3; ++i) {
      ChartSeries curve =
          series(axes[i].first, axes[i].second, [&at, i](const CalibrationEstimate& c) { return at(c, i); });
      for (const TrueBias& at_time : truth) curve.truth.emplace_back(seconds(at_time.stamp), at_time.bias(i));
      chart.add(curve);
    }
    drawPanel(chart);
  }

  void drawBiases() {
    drawVector(
        "Gyroscope bias", "rad/s",
        [](const CalibrationEstimate& c, int i) {
          return knownPoint(c.gyroscope_bias(i), c.sigma_gyroscope_bias(i), 10.0);
        },
        truth_.gyroscope_biases);
    drawVector(
        "Accelerometer bias", "m/s^2",
        [](const CalibrationEstimate& c, int i) {
          return knownPoint(c.accelerometer_bias(i), c.sigma_accelerometer_bias(i), 10.0);
        },
        truth_.accelerometer_biases);
  }

  void drawVisualScale() {
    LineChart chart("Scale of the visual structure", "m per unit");
    chart.add(series("", kBlue, [](const CalibrationEstimate& c) {
      if (!(c.scale > 0.0)) return Point();
      return knownPoint(c.scale, c.scale * c.sigma_scale, 10.0 * c.scale);
    }));
    drawPanel(chart);
  }

  void drawGravity() {
    drawVector("Gravity in the first keyframe's camera", "m/s^2",
               [](const CalibrationEstimate& c, int i) {
                 if (c.gravity.norm() == 0.0) return Point();
                 return Point{c.gravity(i), c.gravity.norm() * c.sigma_gravity_direction};
               },
               {});
  }

  void drawSingularValues() {
    const std::array<cv::Scalar, 4> colours{kViolet, kBlue, kGreen, kRed};
    LineChart chart("Singular values, Eq. (8)", "");
    for (int i = 0; i < 4; ++i)
      chart.add(series(
          "s" + std::to_string(i + 1), colours[i],
          [i](const CalibrationEstimate& c) {
            if (c.singular_values(0) == 0.0) return Point();
            return Point{c.singular_values(i), 0.0};
          },
          false));
    drawPanel(chart);
  }

  const RunRecord& record_;
  const PlotTruth& truth_;
  cv::Mat image_;
  double duration_ = 1.0;
  int panel_ = 0;
};

}  // namespace

cv::Mat drawConvergence(const RunRecord& record, const PlotTruth& truth, const std::string& title) {
  return ConvergencePlot(record, truth).draw(title);
}

}  // namespace autocal_vio
