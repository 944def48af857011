#include "autocal_vio/tools/line_chart.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

namespace autocal_vio {
namespace {

const cv::Scalar kInk(60, 60, 60);
const cv::Scalar kGrid(225, 225, 225);
const cv::Scalar kWhite(255, 255, 255);
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kTextScale = 0.45;
constexpr double kTitleScale = 0.55;

// A position that stays representable however far off the frame a value is.
int clampedPixel(double value) {
  return static_cast<int>(std::lround(std::clamp(value, -3e4, 3e4)));
}

cv::Size textSize(const std::string& text, double scale) {
  int baseline = 0;
  return cv::getTextSize(text, kFont, scale, 1, &baseline);
}

void putText(cv::Mat* image, const std::string& text, const cv::Point& origin, double scale) {
  cv::putText(*image, text, origin, kFont, scale, kInk, 1, cv::LINE_AA);
}

// As many decimals as neighbouring ticks need to differ.
std::string tickText(double value, double step) {
  const int decimals = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 9);
  char text[48];
  std::snprintf(text, sizeof(text), "%.*f", decimals, std::abs(value) < 1e-9 * step ? 0.0 : value);
  return text;
}

void include(double value, ChartRange* range) {
  if (!std::isfinite(value)) return;
  range->low = std::min(range->low, value);
  range->high = std::max(range->high, value);
}

// Widened by a margin; never empty, nor so narrow that its ticks' texts do not fit beside the frame.
ChartRange padded(ChartRange range) {
  if (!(range.low <= range.high)) return {};
  const double smallest = std::max(1e-4, 1e-4 * std::max(std::abs(range.low), std::abs(range.high)));
  const double margin = std::max(0.12 * (range.high - range.low), smallest);
  return {range.low - margin, range.high + margin};
}

// Between the points of a curve, level beyond its ends.
double valueAt(const std::vector<cv::Point2d>& curve, double time) {
  const auto after = std::lower_bound(curve.begin(), curve.end(), time,
                                      [](const cv::Point2d& point, double t) { return point.x < t; });
  if (after == curve.begin()) return curve.front().y;
  if (after == curve.end()) return curve.back().y;
  const cv::Point2d &a = *(after - 1), &b = *after;
  return a.y + (b.y - a.y) * (time - a.x) / (b.x - a.x);
}

}  // namespace

std::vector<double> LineChart::ticks(const ChartRange& range, int count) {
  const double raw = (range.high - range.low) / std::max(1, count);
  if (!(raw > 0.0) || !std::isfinite(raw)) return {};
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10.0 * power;
  for (double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= raw * 0.999) {
      step = factor * power;
      break;
    }
  }
  std::vector<double> result;
  for (double i = std::ceil(range.low / step - 1e-9); i * step <= range.high + 1e-9 * step; i += 1.0)
    result.push_back(i * step);
  return result;
}

ChartRange LineChart::valueRange() const {
  ChartRange range{INFINITY, -INFINITY};
  for (const ChartSeries& series : series_) {
    for (const cv::Point2d& point : series.truth) include(point.y, &range);
    std::vector<std::size_t> known;
    for (std::size_t i = 0; i < series.value.size(); ++i) {
      if (std::isfinite(series.value[i])) known.push_back(i);
    }
    for (std::size_t k = known.size() / 3; k < known.size(); ++k) {
      const std::size_t i = known[k];
      include(series.value[i], &range);
      // Bands count from half-way on: early ones are as wide as ignorance.
      if (series.sigma.empty() || k < known.size() / 2) continue;
      include(series.value[i] - 3.0 * series.sigma[i], &range);
      include(series.value[i] + 3.0 * series.sigma[i], &range);
    }
  }
  return padded(range);
}

cv::Point LineChart::toPixel(double time, double value, const ChartRange& range, const cv::Size& size) const {
  const double x = (time - time_range_.low) / std::max(1e-9, time_range_.high - time_range_.low);
  const double y = (value - range.low) / (range.high - range.low);
  return {clampedPixel(x * (size.width - 1)), clampedPixel((1.0 - y) * (size.height - 1))};
}

void LineChart::drawAxes(cv::Mat* image, const cv::Rect& frame, const ChartRange& range) const {
  const std::vector<double> values = ticks(range, 5);
  const double value_step = values.size() > 1 ? values[1] - values[0] : 1.0;
  for (double value : values) {
    const int y = frame.y + toPixel(0.0, value, range, frame.size()).y;
    cv::line(*image, {frame.x, y}, {frame.x + frame.width - 1, y}, kGrid);
    const std::string text = tickText(value, value_step);
    const cv::Size size = textSize(text, kTextScale);
    putText(image, text, {frame.x - size.width - 6, y + size.height / 2}, kTextScale);
  }
  const std::vector<double> times = ticks(time_range_, 6);
  const double time_step = times.size() > 1 ? times[1] - times[0] : 1.0;
  for (double time : times) {
    const int x = frame.x + toPixel(time, range.low, range, frame.size()).x;
    cv::line(*image, {x, frame.y}, {x, frame.y + frame.height - 1}, kGrid);
    const std::string text = tickText(time, time_step);
    const cv::Size size = textSize(text, kTextScale);
    putText(image, text, {x - size.width / 2, frame.y + frame.height + size.height + 6}, kTextScale);
  }
}

void LineChart::drawBand(cv::Mat* plot, const ChartSeries& series, const ChartRange& range) const {
  if (series.sigma.empty()) return;
  cv::Mat shaded = plot->clone();
  for (std::size_t i = 1; i < series.value.size(); ++i) {
    const double widest = std::max(3.0 * series.sigma[i - 1], 3.0 * series.sigma[i]);
    if (!std::isfinite(series.value[i - 1]) || !std::isfinite(series.value[i]) || !std::isfinite(widest))
      continue;
    const auto corner = [&](std::size_t k, double side) {
      return toPixel(series.time[k], series.value[k] + side * 3.0 * series.sigma[k], range, plot->size());
    };
    const std::vector<cv::Point> quad = {corner(i - 1, 1.0), corner(i, 1.0), corner(i, -1.0),
                                         corner(i - 1, -1.0)};
    cv::fillConvexPoly(shaded, quad, series.colour);
  }
  cv::addWeighted(shaded, 0.22, *plot, 0.78, 0.0, *plot);
}

void LineChart::drawCurve(cv::Mat* plot, const ChartSeries& series, const ChartRange& range) const {
  for (std::size_t i = 1; i < series.value.size(); ++i) {
    if (!std::isfinite(series.value[i - 1]) || !std::isfinite(series.value[i])) continue;
    cv::line(*plot, toPixel(series.time[i - 1], series.value[i - 1], range, plot->size()),
             toPixel(series.time[i], series.value[i], range, plot->size()), series.colour, 2, cv::LINE_AA);
  }
}

void LineChart::drawTruth(cv::Mat* plot, const ChartSeries& series, const ChartRange& range) const {
  if (series.truth.empty()) return;
  const double per_pixel = (time_range_.high - time_range_.low) / std::max(1, plot->cols - 1);
  const auto pixel = [&](int x) {
    const double time = time_range_.low + per_pixel * x;
    return cv::Point(x, toPixel(time, valueAt(series.truth, time), range, plot->size()).y);
  };
  for (int x = 0; x < plot->cols; x += 14)
    cv::line(*plot, pixel(x), pixel(x + 7), series.colour * 0.6, 1, cv::LINE_AA);
}

void LineChart::drawLegend(cv::Mat* plot) const {
  int x = 8;
  for (const ChartSeries& series : series_) {
    if (series.label.empty()) continue;
    const cv::Size size = textSize(series.label, kTextScale);
    const cv::Rect box(x, 6, size.width + 32, 18);
    if (box.x + box.width >= plot->cols || box.y + box.height >= plot->rows) return;
    cv::rectangle(*plot, box, kWhite, cv::FILLED);
    cv::line(*plot, {x + 4, 15}, {x + 22, 15}, series.colour, 2, cv::LINE_AA);
    putText(plot, series.label, {x + 27, 20}, kTextScale);
    x += box.width + 6;
  }
}

void LineChart::draw(cv::Mat* image, const cv::Rect& area) const {
  const cv::Rect frame(area.x + 78, area.y + 30, area.width - 96, area.height - 66);
  const ChartRange range = valueRange();
  putText(image, unit_.empty() ? title_ : title_ + " [" + unit_ + "]", {frame.x, area.y + 20}, kTitleScale);
  drawAxes(image, frame, range);
  cv::Mat plot = (*image)(frame);  // drawing into it clips at the frame
  for (const ChartMarker& marker : markers_) {
    const int x = toPixel(marker.time, range.low, range, plot.size()).x;
    cv::line(plot, {x, 0}, {x, plot.rows - 1}, marker.colour, 1);
  }
  for (const ChartSeries& series : series_) drawBand(&plot, series, range);
  for (const ChartSeries& series : series_) drawTruth(&plot, series, range);
  for (const ChartSeries& series : series_) drawCurve(&plot, series, range);
  drawLegend(&plot);
  cv::rectangle(*image, frame, kInk);
}

}  // namespace autocal_vio
