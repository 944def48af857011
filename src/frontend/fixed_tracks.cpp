#include "autocal_vio/frontend/fixed_tracks.h"

#include <algorithm>
#include <opencv2/core.hpp>

namespace autocal_vio {
namespace {

constexpr double kLeastStep = 1.0;       // [px] by rotation, or it says nothing
constexpr double kLargestMiss = 0.5;     // of a step: a track that misses by less goes where it leads
constexpr double kAgreeingShare = 0.25;  // of all tracks, or the prediction is not believed
constexpr std::size_t kAgreeingTracks = 8;
constexpr double kStill = 1.0;  // [px] from where it was
// A point that the camera circles may stay as long: it is lost to the estimate, and no more.
constexpr double kTurnedUntilFixed = 40.0;  // [px]
constexpr int kImagesUntilFixed = 5;

}  // namespace

bool isPredictionRight(const std::vector<cv::Point2f>& before, const std::vector<cv::Point2f>& predicted,
                       const std::vector<Track>& tracks) {
  std::size_t agreeing = 0;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    const double step = cv::norm(predicted[i] - before[i]);
    agreeing += step > kLeastStep && cv::norm(tracks[i].pixel - predicted[i]) < kLargestMiss * step;
  }
  return agreeing >= kAgreeingTracks &&
         static_cast<double>(agreeing) > kAgreeingShare * static_cast<double>(tracks.size());
}

void markFixedTracks(const std::vector<cv::Point2f>& before, const std::vector<cv::Point2f>& predicted,
                     std::vector<Track>* tracks) {
  const bool right = isPredictionRight(before, predicted, *tracks);
  for (std::size_t i = 0; i < tracks->size(); ++i) {
    Track& track = (*tracks)[i];
    Stillness& still = track.stillness;
    if (still.is_fixed) continue;  // until it is lost, however it shakes
    if (cv::norm(track.pixel - still.pixel) > kStill) {
      still = Stillness{track.pixel};
      continue;
    }
    const double step = cv::norm(predicted[i] - before[i]);
    if (!right || step < kLeastStep) continue;
    still.turned += step;
    ++still.images;
    if (still.turned > kTurnedUntilFixed && still.images >= kImagesUntilFixed) still.is_fixed = true;
  }
}

}  // namespace autocal_vio
