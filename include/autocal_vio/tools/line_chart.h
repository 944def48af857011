// A chart of curves over time, drawn with OpenCV.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace autocal_vio {

/// One curve. Values that are not finite are gaps.
struct ChartSeries {
  std::string label;
  cv::Scalar colour;
  std::vector<double> time;  ///< [s]
  std::vector<double> value;
  std::vector<double> sigma;  ///< a band of 3 sigma around the curve; empty: none
  /// (time, value), in order of time: dashed in the curve's colour, level before the first and after the last.
  std::vector<cv::Point2d> truth = {};
};

/// A vertical line.
struct ChartMarker {
  double time = 0.0;  ///< [s]
  cv::Scalar colour;
};

struct ChartRange {
  double low = 0.0;
  double high = 1.0;
};

class LineChart {
 public:
  LineChart(std::string title, std::string unit) : title_(std::move(title)), unit_(std::move(unit)) {}

  void add(ChartSeries series) { series_.push_back(std::move(series)); }
  void add(const ChartMarker& marker) { markers_.push_back(marker); }
  void setTimeRange(const ChartRange& range) { time_range_ = range; }

  /// Values shown: all truths and the curves' later two thirds with their bands, so that the first guesses do
  /// not flatten everything else; curves are clipped at the frame.
  ChartRange valueRange() const;

  /// Draws title, axes, curves and legend into `area` of a CV_8UC3 image.
  void draw(cv::Mat* image, const cv::Rect& area) const;

  /// About `count` round values within the range, in ascending order.
  static std::vector<double> ticks(const ChartRange& range, int count);

 private:
  cv::Point toPixel(double time, double value, const ChartRange& range, const cv::Size& size) const;
  void drawAxes(cv::Mat* image, const cv::Rect& frame, const ChartRange& range) const;
  void drawBand(cv::Mat* plot, const ChartSeries& series, const ChartRange& range) const;
  void drawCurve(cv::Mat* plot, const ChartSeries& series, const ChartRange& range) const;
  void drawTruth(cv::Mat* plot, const ChartSeries& series, const ChartRange& range) const;
  void drawLegend(cv::Mat* plot) const;

  std::string title_;
  std::string unit_;
  std::vector<ChartSeries> series_;
  std::vector<ChartMarker> markers_;
  ChartRange time_range_;
};

}  // namespace autocal_vio
