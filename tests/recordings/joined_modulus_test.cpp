#include "client/recordings/joined_modulus.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace teletact::client {
namespace {

constexpr MapNodes kNodes{60, 80, 0.5e-3, 0.5e-3};
constexpr std::size_t kSize = kNodes.nx * kNodes.ny;

double truth(std::size_t n) {
  return std::log(10e3) + (std::hypot(double(n % kNodes.nx) - 30, double(n / kNodes.nx) - 40) < 10 ? 1.1 : 0);
}

// Errors alike over some 3 mm, of unit variance.
std::vector<double> blurred_noise(std::mt19937& random) {
  constexpr int kReach = 3;
  std::normal_distribution<double> normal;
  std::vector<double> white(kSize), out(kSize);
  for (double& w : white) w = normal(random);
  for (std::size_t n = 0; n < kSize; ++n) {
    double sum = 0, count = 0;
    const int i = int(n % kNodes.nx), j = int(n / kNodes.nx);
    for (int dj = -kReach; dj <= kReach; ++dj)
      for (int di = -kReach; di <= kReach; ++di)
        if (i + di >= 0 && j + dj >= 0 && i + di < int(kNodes.nx) && j + dj < int(kNodes.ny))
          sum += white[std::size_t(i + di) + kNodes.nx * std::size_t(j + dj)], ++count;
    out[n] = sum / std::sqrt(count);
  }
  return out;
}

PairModulus pair_of(double deviation, const std::vector<double>& error, double level = 0) {
  PairModulus pair{{}, std::vector<float>(kSize, float(deviation)), 0.9};
  for (std::size_t n = 0; n < kSize; ++n) pair.log_modulus.push_back(float(truth(n) + level + error[n]));
  return pair;
}

std::vector<double> sum(double a, const std::vector<double>& x, double b, const std::vector<double>& y) {
  std::vector<double> out(kSize);
  for (std::size_t n = 0; n < kSize; ++n) out[n] = a * x[n] + b * y[n];
  return out;
}

// Root mean square of the error over the deviation that is stated.
double standardised(const JoinedModulus& joined) {
  double squares = 0;
  for (std::size_t n = 0; n < kSize; ++n)
    squares += std::pow((joined.log_modulus[n] - truth(n)) / joined.log_deviation[n], 2);
  return std::sqrt(squares / kSize);
}

double median(std::vector<float> values) {
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(values.size() / 2), values.end());
  return values[values.size() / 2];
}

TEST(JoinedModulus, OnePairIsAsItWas) {
  std::mt19937 random(1);
  const PairModulus pair = pair_of(0.1, sum(0.1, blurred_noise(random), 0, std::vector<double>(kSize)));
  const JoinedModulus joined = join_moduli(kNodes, {pair}, true);
  EXPECT_EQ(joined.used, 1u);
  for (std::size_t n = 0; n < kSize; ++n) {
    EXPECT_FLOAT_EQ(joined.log_modulus[n], pair.log_modulus[n]);
    EXPECT_FLOAT_EQ(joined.log_deviation[n], 0.1f);
  }
}

// The same pair twenty times tells no more than once.
TEST(JoinedModulus, CopiesDoNotMakeItSurer) {
  std::mt19937 random(2);
  const PairModulus pair = pair_of(0.1, sum(0.1, blurred_noise(random), 0, std::vector<double>(kSize)));
  const JoinedModulus joined = join_moduli(kNodes, std::vector<PairModulus>(20, pair), true);
  EXPECT_NEAR(median(joined.log_deviation), 0.1, 1e-4);
  EXPECT_NEAR(joined.scatter, 0, 1e-4);
}

// Errors of which a part is alike in all pairs: the rest falls with their number, and what is stated holds.
TEST(JoinedModulus, OnlyWhatDiffersFallsWithTheNumber) {
  constexpr double kShared = 0.08, kOwn = 0.06;  // 0.1 together
  double squares = 0;
  constexpr int kTrials = 12;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::mt19937 random(10 + unsigned(trial));
    const std::vector<double> shared = blurred_noise(random);
    std::vector<PairModulus> pairs;
    for (int p = 0; p < 9; ++p)
      pairs.push_back(pair_of(0.1, sum(kShared, shared, kOwn, blurred_noise(random))));
    const JoinedModulus joined = join_moduli(kNodes, pairs, true);
    EXPECT_NEAR(joined.scatter, kOwn, 0.012) << trial;
    EXPECT_NEAR(joined.shared, kShared, 0.01) << trial;
    EXPECT_NEAR(median(joined.log_deviation), std::hypot(kShared, kOwn / 3), 0.01) << trial;
    squares += std::pow(standardised(joined), 2);
  }
  const double whole = std::sqrt(squares / kTrials);
  EXPECT_GE(whole, 0.85);
  EXPECT_LE(whole, 1.15);
}

// However many pairs there are: what they share is at least half of the variance that one states.
TEST(JoinedModulus, ManyPairsDoNotMakeItSure) {
  std::mt19937 random(3);
  std::vector<PairModulus> pairs;
  for (int p = 0; p < 30; ++p)
    pairs.push_back(pair_of(0.1, sum(0.1, blurred_noise(random), 0, std::vector<double>(kSize))));
  const JoinedModulus joined = join_moduli(kNodes, pairs, true);
  EXPECT_GE(median(joined.log_deviation), 0.07);
  EXPECT_FALSE(joined.differ);
}

// A gain, or a speed of sound, is as wrong in all pairs, however much their maps differ.
TEST(JoinedModulus, WhatPairsStateToShareStays) {
  std::mt19937 random(6);
  std::vector<PairModulus> pairs;
  for (int p = 0; p < 9; ++p) {
    pairs.push_back(pair_of(0.1, sum(0.1, blurred_noise(random), 0, std::vector<double>(kSize))));
    pairs.back().shared_deviation = 0.09;
  }
  const JoinedModulus joined = join_moduli(kNodes, pairs, true);
  EXPECT_NEAR(joined.shared, 0.09, 1e-6);
  EXPECT_NEAR(median(joined.log_deviation), std::hypot(0.09, 0.1 / 3), 0.005);
}

TEST(JoinedModulus, TheSurerPairWeighsMore) {
  std::mt19937 random(4);
  const std::vector<double> none(kSize);
  const JoinedModulus joined = join_moduli(kNodes,
                                           {pair_of(0.1, sum(0.1, blurred_noise(random), 0, none)),
                                            pair_of(0.2, sum(0.2, blurred_noise(random), 0, none))},
                                           true);
  EXPECT_NEAR(joined.pairs[0].share, 0.8, 0.01);
  EXPECT_NEAR(joined.pairs[1].share, 0.2, 0.01);
}

TEST(JoinedModulus, WhatIsOfLowQualityOrDiffersIsLeftOutAndNamed) {
  std::mt19937 random(5);
  const std::vector<double> none(kSize);
  std::vector<PairModulus> pairs;
  for (int p = 0; p < 4; ++p) pairs.push_back(pair_of(0.1, sum(0.05, blurred_noise(random), 0, none)));
  pairs.push_back(pair_of(0.1, none, std::log(1.5)));  // its force was wrong
  pairs.push_back(pair_of(0.1, none));
  pairs.back().quality = 0.4;
  const JoinedModulus joined = join_moduli(kNodes, pairs, true);
  EXPECT_EQ(joined.used, 4u);
  EXPECT_NE(joined.pairs[4].left_out.find("times their modulus"), std::string::npos)
      << joined.pairs[4].left_out;
  EXPECT_NE(joined.pairs[5].left_out.find("quality 0.40"), std::string::npos) << joined.pairs[5].left_out;
  // Without a force the level says nothing.
  const JoinedModulus relative = join_moduli(kNodes, pairs, false);
  EXPECT_EQ(relative.used, 5u);
  EXPECT_NEAR(std::log(relative.pairs[4].level / relative.pairs[0].level), std::log(1.5), 0.03);
  EXPECT_NEAR(median(relative.log_modulus), 0, 1e-3);
}

TEST(JoinedModulus, TwoThatDifferAreBothKeptAndTold) {
  const std::vector<double> none(kSize);
  const JoinedModulus joined = join_moduli(kNodes, {pair_of(0.1, none), pair_of(0.1, none, 0.5)}, true);
  EXPECT_EQ(joined.used, 2u);
  EXPECT_TRUE(joined.differ);
  EXPECT_GE(median(joined.log_deviation), 0.2) << "half of what they differ by";
}

TEST(JoinedModulus, NodesThatNoPairTellsStayUnsaid) {
  const std::vector<double> none(kSize);
  PairModulus a = pair_of(0.1, none), b = pair_of(0.1, none);
  a.log_modulus[7] = b.log_modulus[7] = NAN;
  a.log_modulus[8] = NAN;
  const JoinedModulus joined = join_moduli(kNodes, {a, b}, true);
  EXPECT_TRUE(std::isnan(joined.log_modulus[7]));
  EXPECT_TRUE(std::isnan(joined.log_deviation[7]));
  EXPECT_FLOAT_EQ(joined.log_deviation[8], 0.1f);
}

TEST(JoinedModulus, MapsThatDoNotFillTheNodesAreRefused) {
  EXPECT_THROW(join_moduli(kNodes, {}, true), std::invalid_argument);
  EXPECT_THROW(join_moduli(kNodes, {PairModulus{}}, true), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::client
