#include "autocal_vio/common/angle.h"
#include "autocal_vio/pipeline/prior_judge.h"

#include <gtest/gtest.h>

#include <string>

namespace autocal_vio {
namespace {

constexpr double kSigmaRotation = 0.5 * kDegree, kSigmaTranslation = 0.01;
constexpr TimeNs kKeyframe = 200000000;

ExtrinsicsPrior prior(bool from_session = false) {
  return {Transform(), kSigmaRotation, kSigmaTranslation, from_session};
}

// Data that know all axes to 0.05 deg and 2 mm, and say what the estimate says. The prior may still hold that back: "at least".
PriorEvidence evidence(double translation_off, double rotation_off_deg) {
  PriorEvidence result;
  result.estimate << translation_off, 0.0, 0.0, 0.0, rotation_off_deg * kDegree, 0.0;
  result.data = result.estimate;
  result.data_covariance.setZero();
  result.data_covariance.diagonal() << Eigen::Vector3d::Constant(0.002 * 0.002),
      Eigen::Vector3d::Constant(0.05 * kDegree * 0.05 * kDegree);
  return result;
}

// After how many keyframes the prior is condemned; 0: not in twenty.
int condemnedAfter(PriorJudge* judge, const PriorEvidence& evidence, const FreezeSelection& held = {}) {
  for (int k = 1; k <= 20; ++k)
    if (judge->condemns(evidence, held, k * kKeyframe)) return k;
  return 0;
}

bool says(const PriorJudge& judge, const std::string& text) {
  return judge.problem().find(text) != std::string::npos;
}

TEST(PriorJudge, NamesTheHalfThatIsWrong) {
  PriorJudge rotation(prior(), Matrix6d::Zero());
  EXPECT_GT(condemnedAfter(&rotation, evidence(0.01, 4.0)), 0);
  EXPECT_TRUE(says(rotation, "rotation is at least 4 deg off")) << rotation.problem();
  PriorJudge translation(prior(), Matrix6d::Zero());
  EXPECT_GT(condemnedAfter(&translation, evidence(0.08, 0.5)), 0);
  EXPECT_TRUE(says(translation, "translation is at least 8 cm off")) << translation.problem();
  PriorJudge both(prior(), Matrix6d::Zero());
  EXPECT_GT(condemnedAfter(&both, evidence(0.2, 4.0)), 0);  // 20 and 8 sigmas
  EXPECT_TRUE(says(both, "translation is at least 20 cm off")) << both.problem();
}

TEST(PriorJudge, IsSatisfiedWithFewSigmas) {
  PriorJudge judge(prior(), Matrix6d::Zero());
  EXPECT_EQ(condemnedAfter(&judge, evidence(0.035, 1.7)), 0);
  EXPECT_TRUE(judge.problem().empty());
}

TEST(PriorJudge, AContradictionHasToLast) {
  PriorJudge judge(prior(), Matrix6d::Zero());
  const PriorEvidence wrong = evidence(0.0, 4.0), right = evidence(0.0, 0.0);
  for (int k = 0; k < 20; ++k)
    EXPECT_FALSE(judge.condemns(k % 3 ? wrong : right, {}, k * kKeyframe));  // 0.2 s at a time
  EXPECT_FALSE(judge.condemns(wrong, {}, 20 * kKeyframe));
  EXPECT_FALSE(judge.condemns(wrong, {}, 22 * kKeyframe));
  EXPECT_TRUE(judge.condemns(wrong, {}, 24 * kKeyframe));
  EXPECT_FALSE(judge.condemns(wrong, {}, 30 * kKeyframe));  // once
}

TEST(PriorJudge, WhatIsHeldIsNotJudged) {
  PriorJudge judge(prior(), Matrix6d::Zero());
  const FreezeSelection rotation_held{true, false, false};
  EXPECT_EQ(condemnedAfter(&judge, evidence(0.0, 4.0), rotation_held), 0);
  EXPECT_GT(condemnedAfter(&judge, evidence(0.08, 4.0), rotation_held), 0);
  EXPECT_TRUE(says(judge, "translation")) << judge.problem();
}

// The estimate is where the prior holds it; the data alone are far away.
TEST(PriorJudge, TheDataAloneOverruleATightPrior) {
  PriorJudge judge({{Transform(), 0.02 * kDegree, 0.001}}, Matrix6d::Zero());
  PriorEvidence held_back = evidence(0.03, 0.0);
  held_back.estimate[0] = 0.002;
  EXPECT_GT(condemnedAfter(&judge, held_back), 0);
  EXPECT_TRUE(says(judge, "translation is 3 cm off")) << judge.problem();
}

TEST(PriorJudge, DirectionsThatTheDataDoNotKnowDoNotCount) {
  PriorJudge judge(prior(), Matrix6d::Zero());
  PriorEvidence unknown = evidence(0.3, 0.0);
  unknown.estimate.setZero();
  unknown.data_covariance(0, 0) = 0.06 * 0.06;  // 5 sigmas, but of an axis known to 6 cm only
  EXPECT_EQ(condemnedAfter(&judge, unknown), 0) << judge.problem();
}

// A wrong principal point turns what the data say by as much.
TEST(PriorJudge, TheIntrinsicsMayBeToBlame) {
  Matrix6d share = Matrix6d::Zero();
  share(4, 4) = kDegree * kDegree;
  PriorJudge judge(prior(), share);
  EXPECT_EQ(condemnedAfter(&judge, evidence(0.0, 4.0)), 0) << judge.problem();
}

TEST(PriorJudge, IsBlamedWhereTheEstimateStrainsAtIt) {
  const PriorEvidence strained = evidence(0.0, 1.2);
  PriorJudge judge(prior(), Matrix6d::Zero());
  judge.blame(evidence(0.01, 0.5), {});
  EXPECT_TRUE(judge.problem().empty());
  judge.blame(strained, {true, false, false});
  EXPECT_TRUE(judge.problem().empty());
  judge.blame(strained, {});
  EXPECT_TRUE(says(judge, "rotation")) << judge.problem();

  PriorJudge own(prior(true), Matrix6d::Zero());
  own.blame(strained, {});
  EXPECT_TRUE(own.problem().empty());
  PriorJudge confirmed(prior(), Matrix6d::Zero());
  PriorEvidence converged = strained;
  converged.confirmed = true;
  confirmed.blame(converged, {});
  EXPECT_TRUE(confirmed.problem().empty());
}

TEST(PriorJudge, AMountThatMovedBeforeItWasConfirmedWasWrong) {
  PriorJudge judge(prior(), Matrix6d::Zero());
  judge.noteMovedMount(evidence(0.0, 3.0));
  EXPECT_TRUE(says(judge, "rotation is 3 deg off")) << judge.problem();
  EXPECT_FALSE(judge.prior());
  EXPECT_TRUE(judge.given());

  PriorJudge confirmed(prior(), Matrix6d::Zero());
  PriorEvidence converged = evidence(0.0, 3.0);
  converged.confirmed = true;
  confirmed.noteMovedMount(converged);
  EXPECT_TRUE(confirmed.problem().empty());
  EXPECT_EQ(condemnedAfter(&confirmed, evidence(0.0, 3.0)), 0);  // history
}

TEST(PriorJudge, NothingGivenNothingWrong) {
  PriorJudge judge(std::nullopt, Matrix6d::Zero());
  EXPECT_EQ(condemnedAfter(&judge, evidence(1.0, 90.0)), 0);
  judge.blame(evidence(1.0, 90.0), {});
  judge.noteMovedMount(evidence(1.0, 90.0));
  EXPECT_TRUE(judge.problem().empty());
  EXPECT_FALSE(judge.given());
}

}  // namespace
}  // namespace autocal_vio
