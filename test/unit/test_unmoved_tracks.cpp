#include "autocal_vio/frontend/unmoved_tracks.h"

#include <gtest/gtest.h>

namespace autocal_vio {
namespace {

std::vector<Feature> tracks(int first, int count) {
  std::vector<Feature> features;
  for (int i = first; i < first + count; ++i) {
    Feature feature;
    feature.track_id = i;
    feature.pixel = {10.3 * i, 5.7 * i};
    features.push_back(feature);
  }
  return features;
}

TEST(UnmovedTracks, TheSameImageAgainHasNotMoved) {
  UnmovedTracks unmoved;
  EXPECT_FALSE(unmoved.look(tracks(0, 20))) << "nothing to compare with";
  EXPECT_TRUE(unmoved.look(tracks(0, 20)));
  EXPECT_TRUE(unmoved.look(tracks(0, 20)));
}

// Of a rig at rest every track moves a little: it is another image.
TEST(UnmovedTracks, NoiseOfOneTrackHas) {
  std::vector<Feature> features = tracks(0, 20);
  UnmovedTracks unmoved;
  unmoved.look(features);
  features[7].pixel.x() += 1e-4;
  EXPECT_FALSE(unmoved.look(features));
  EXPECT_TRUE(unmoved.look(features)) << "each is compared with the one before";
}

TEST(UnmovedTracks, OnlyCommonTracksTell) {
  UnmovedTracks unmoved;
  unmoved.look(tracks(0, 20));
  EXPECT_TRUE(unmoved.look(tracks(10, 20)));
  EXPECT_FALSE(unmoved.look(tracks(25, 20))) << "five in common";
  EXPECT_FALSE(unmoved.look({}));
  EXPECT_FALSE(unmoved.look(tracks(25, 20)));
}

}  // namespace
}  // namespace autocal_vio
