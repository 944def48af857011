#include "autocal_vio/frontend/corner_detector.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <tuple>
#include <utility>

namespace autocal_vio {
namespace {

constexpr int kBorder = 4;                // [px] a patch nearer to the edge is mostly outside
constexpr double kTracksPerCell = 4.5;    // of a full image
constexpr int kBlock = 3;                 // [px] side of the block whose gradients make a corner
constexpr int kMargin = kBlock / 2 + 2;   // [px] of the block, its gradients, and the neighbours compared
constexpr double kCellsPerImage = 0.25;   // share of the cells searched at most, once the image is half full
constexpr std::int64_t kBarrenRest = 10;  // images for which a cell without corners is left alone
constexpr int kMoreThanQuota = 2;         // corners that a full cell takes for others that have none
// cv::cornerMinEigenVal divides 8-bit gradients by 255 and weighs them so that this times the root of its response is
// the root mean square of the gradient in the weaker direction [gray levels per px].
constexpr double kContrastOfResponse = 127.5;

bool isLocalMaximum(const cv::Mat& response, int x, int y) {
  const float value = response.at<float>(y, x);
  for (int dy = -1; dy <= 1; ++dy) {
    const float* row = response.ptr<float>(y + dy) + x;
    if (row[-1] > value || row[0] > value || row[1] > value) return false;
  }
  return true;
}

}  // namespace

CornerDetector::CornerDetector(const cv::Size& image_size, const FeatureTrackerOptions& options)
    : options_(options), image_size_(image_size) {
  const double side = std::sqrt(kTracksPerCell * image_size.area() / options.max_features);
  columns_ = std::max(1, static_cast<int>(std::lround(image_size.width / side)));
  rows_ = std::max(1, static_cast<int>(std::lround(image_size.height / side)));
  quota_ = std::max(1, options.max_features / (columns_ * rows_));
  reset();
}

void CornerDetector::reset() {
  cells_.assign(static_cast<std::size_t>(columns_) * rows_, Cell());
  for (int i = 0; i < columns_ * rows_; ++i) {
    const int column = i % columns_, row = i / columns_;
    const cv::Point begin(column * image_size_.width / columns_, row * image_size_.height / rows_);
    const cv::Point end((column + 1) * image_size_.width / columns_, (row + 1) * image_size_.height / rows_);
    cells_[i].area = cv::Rect(begin, end);
  }
  image_ = 0;
}

int CornerDetector::cellOf(const cv::Point2f& pixel) const {
  const int column = static_cast<int>(pixel.x) * columns_ / image_size_.width;
  const int row = static_cast<int>(pixel.y) * rows_ / image_size_.height;
  return std::clamp(row, 0, rows_ - 1) * columns_ + std::clamp(column, 0, columns_ - 1);
}

std::vector<int> CornerDetector::cellsToSearch(int missing) const {
  // A new or a lost image is filled at once.
  const bool half_empty = 2 * missing > options_.max_features;
  std::vector<std::tuple<int, std::int64_t, int>> order;
  for (int i = 0; i < static_cast<int>(cells_.size()); ++i) {
    const Cell& cell = cells_[i];
    const bool rests = cell.barren && image_ - cell.searched < kBarrenRest;
    if (half_empty || !rests) order.emplace_back(cell.tracks, cell.searched, i);
  }
  std::sort(order.begin(), order.end());
  const double most = half_empty ? 1.0 : kCellsPerImage;
  order.resize(std::min(order.size(), static_cast<std::size_t>(std::ceil(most * cells_.size()))));
  std::vector<int> cells;
  for (const auto& [tracks, searched, i] : order) cells.push_back(i);
  return cells;
}

std::vector<cv::Point2f> CornerDetector::detect(const cv::Mat& image, const std::vector<cv::Point2f>& tracks,
                                                int missing) {
  ++image_;
  std::vector<cv::Point2f> corners;
  if (missing <= 0) return corners;
  for (Cell& cell : cells_) cell.tracks = 0;
  for (const cv::Point2f& track : tracks) ++cells_[cellOf(track)].tracks;
  std::vector<cv::Point2f> taken = tracks;
  const auto isFree = [&](const cv::Point2f& corner) {
    return std::none_of(taken.begin(), taken.end(), [&](const cv::Point2f& other) {
      return std::hypot(corner.x - other.x, corner.y - other.y) < options_.min_distance;
    });
  };
  for (const int index : cellsToSearch(missing)) {
    if (missing <= 0) break;
    Cell& cell = cells_[index];
    int wanted = std::min(missing, std::max(quota_ - cell.tracks, kMoreThanQuota));
    cell.searched = image_;
    cell.barren = true;
    for (const cv::Point& candidate : cornersIn(image, cell.area)) {
      const cv::Point2f corner(candidate);
      if (!isFree(corner)) continue;
      corners.push_back(corner);
      taken.push_back(corner);
      cell.barren = false;
      --missing;
      if (--wanted == 0) break;
    }
  }
  return corners;
}

// All corners of a cell, the best first.
std::vector<cv::Point> CornerDetector::cornersIn(const cv::Mat& image, const cv::Rect& area) const {
  const cv::Rect frame(0, 0, image.cols, image.rows);
  const cv::Rect searched =
      area & cv::Rect(kBorder, kBorder, frame.width - 2 * kBorder, frame.height - 2 * kBorder);
  std::vector<cv::Point> corners;
  if (searched.empty()) return corners;
  const cv::Rect window = frame & cv::Rect(searched.x - kMargin, searched.y - kMargin,
                                           searched.width + 2 * kMargin, searched.height + 2 * kMargin);
  cv::Mat response;
  cv::cornerMinEigenVal(image(window), response, kBlock, 3);
  const auto least = static_cast<float>(std::pow(options_.min_contrast / kContrastOfResponse, 2));
  std::vector<std::pair<float, cv::Point>> found;
  for (int y = searched.y - window.y; y < searched.br().y - window.y; ++y) {
    for (int x = searched.x - window.x; x < searched.br().x - window.x; ++x) {
      const float value = response.at<float>(y, x);
      if (value >= least && isLocalMaximum(response, x, y))
        found.emplace_back(value, cv::Point(x, y) + window.tl());
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  for (const auto& [value, corner] : found) corners.push_back(corner);
  return corners;
}

}  // namespace autocal_vio
