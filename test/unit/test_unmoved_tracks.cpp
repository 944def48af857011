#include "autocal_vio/frontend/unmoved_tracks.h"

#include <gtest/gtest.h>

namespace autocal_vio {
namespace {

std::vector<Feature> tracks(int first, int count, double shift) {
  std::vector<Feature> features;
  for (int i = first; i < first + count; ++i) {
    Feature feature;
    feature.track_id = i;
    feature.pixel = {10.0 * i + shift, 5.0 * i};
    features.push_back(feature);
  }
  return features;
}

TEST(UnmovedTracks, TheSameImageAgainHasNotMoved) {
  UnmovedTracks unmoved;
  EXPECT_FALSE(unmoved.look(tracks(0, 20, 0.0))) << "nothing to compare with";
  EXPECT_TRUE(unmoved.look(tracks(0, 20, 0.0)));
  EXPECT_TRUE(unmoved.look(tracks(0, 20, 0.005)));
}

TEST(UnmovedTracks, ATenthOfAPixelHas) {
  UnmovedTracks unmoved;
  unmoved.look(tracks(0, 20, 0.0));
  EXPECT_FALSE(unmoved.look(tracks(0, 20, 0.1)));
  EXPECT_TRUE(unmoved.look(tracks(0, 20, 0.1))) << "each is compared with the one before";
}

TEST(UnmovedTracks, OnlyCommonTracksTell) {
  UnmovedTracks unmoved;
  unmoved.look(tracks(0, 20, 0.0));
  EXPECT_TRUE(unmoved.look(tracks(10, 20, 0.0)));
  EXPECT_FALSE(unmoved.look(tracks(25, 20, 0.0))) << "five in common";
  EXPECT_FALSE(unmoved.look({}));
  EXPECT_FALSE(unmoved.look(tracks(25, 20, 0.0)));
}

// A few that move stand for the noise of the tracker, a few that do not for a reflection or dirt on the lens.
TEST(UnmovedTracks, TheMedianTells) {
  std::vector<Feature> features = tracks(0, 20, 0.0);
  UnmovedTracks unmoved;
  unmoved.look(features);
  for (int i = 0; i < 6; ++i) features[static_cast<std::size_t>(i)].pixel.x() += 3.0;
  EXPECT_TRUE(unmoved.look(features));
  for (int i = 0; i < 14; ++i) features[static_cast<std::size_t>(i)].pixel.x() += 3.0;
  EXPECT_FALSE(unmoved.look(features));
}

}  // namespace
}  // namespace autocal_vio
