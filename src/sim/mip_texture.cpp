#include "autocal_vio/sim/mip_texture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "autocal_vio/sim/random_source.h"

namespace autocal_vio {
namespace {

constexpr int kSupersampling = 2;
constexpr int kLeaves = 7000;
constexpr double kSmallestLeaf = 4.0;  // half diameter [texel]
constexpr double kLargestLeaf = 80.0;  // half diameter [texel]
constexpr double kDarkest = 25.0, kBrightest = 230.0;
constexpr double kGrain = 3.0;  // standard deviation of the fine noise [gray levels]

std::vector<cv::Point> drawLeaf(double x, double y, double radius, RandomSource* random) {
  const double angle = random->uniform(0.0, CV_PI), width = radius * random->uniform(0.4, 1.0);
  const int corners = random->chance(0.75) ? 4 : 14;
  const double c = std::cos(angle), s = std::sin(angle);
  std::vector<cv::Point> outline;
  for (int i = 0; i < corners; ++i) {
    double a, b;
    if (corners == 4) {
      a = i == 0 || i == 3 ? radius : -radius;
      b = i < 2 ? width : -width;
    } else {
      a = radius * std::cos(2.0 * CV_PI * i / corners);
      b = width * std::sin(2.0 * CV_PI * i / corners);
    }
    outline.emplace_back(cvRound(x + c * a - s * b), cvRound(y + s * a + c * b));
  }
  return outline;
}

// Paints a leaf on a torus: again where it sticks out over an edge.
void paintLeaf(const std::vector<cv::Point>& outline, double gray, cv::Mat* canvas) {
  const cv::Rect box = cv::boundingRect(outline);
  const int size = canvas->rows;
  for (int dx = -size; dx <= size; dx += size) {
    for (int dy = -size; dy <= size; dy += size) {
      const cv::Rect moved = box + cv::Point(dx, dy);
      if ((moved & cv::Rect(0, 0, size, size)).empty()) continue;
      std::vector<cv::Point> points = outline;
      for (cv::Point& point : points) point += cv::Point(dx, dy);
      cv::fillConvexPoly(*canvas, points, cv::Scalar(gray));
    }
  }
}

cv::Mat paintLeaves(int size, RandomSource* random) {
  cv::Mat canvas(size, size, CV_8UC1, cv::Scalar(128));
  const double smallest = kSmallestLeaf * kSupersampling, largest = kLargestLeaf * kSupersampling;
  const double least = 1.0 / (largest * largest), most = 1.0 / (smallest * smallest);
  for (int i = 0; i < kLeaves; ++i) {
    // Density r^-3: the same picture at every scale.
    const double radius = 1.0 / std::sqrt(random->uniform(least, most));
    const double x = random->uniform(0.0, size), y = random->uniform(0.0, size);
    const std::vector<cv::Point> outline = drawLeaf(x, y, radius, random);
    paintLeaf(outline, random->uniform(kDarkest, kBrightest), &canvas);
  }
  return canvas;
}

}  // namespace

MipTexture::MipTexture(std::uint64_t seed) {
  RandomSource random(seed, 50);
  constexpr int kSize = 1 << kSizeLog2;
  cv::Mat level;
  cv::resize(paintLeaves(kSize * kSupersampling, &random), level, cv::Size(kSize, kSize), 0, 0,
             cv::INTER_AREA);
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x)
      level.at<std::uint8_t>(y, x) =
          cv::saturate_cast<std::uint8_t>(level.at<std::uint8_t>(y, x) + kGrain * random.normal());
  std::vector<std::size_t> offsets;
  for (int i = 0; i <= kLevels; ++i) {
    cv::Mat padded, half;
    cv::copyMakeBorder(level, padded, 0, 1, 0, 1, cv::BORDER_WRAP);
    offsets.push_back(texels_.size());
    texels_.insert(texels_.end(), padded.datastart, padded.dataend);
    cv::resize(level, half, cv::Size(level.cols / 2, level.rows / 2), 0, 0, cv::INTER_AREA);
    level = half;
  }
  for (int i = 0; i <= kLevels; ++i) {
    const int size = kSize >> i;
    levels_.push_back({texels_.data() + offsets[i], size + 1, size - 1});
  }
}

}  // namespace autocal_vio
