// Fits of the psychometric function: the paper's figures to the digits, known functions found again, answers
// that bound nothing.
#include "client/experiment/fit.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/experiment/paper_tables.h"

namespace teletact::client {
namespace {

constexpr double kBackgroundNM = 25;
constexpr double kPrintedDigit = 0.0005;

// Answers whose shares are as near to the function as `trials` of each stimulus can be.
std::vector<StimulusCount> answers_of(const Weibull& function, unsigned trials) {
  std::vector<StimulusCount> counts;
  for (int k = 0; k <= 16; ++k) {
    const double stimulus_n_m = 10 + 2.5 * k;
    const auto harder =
        static_cast<unsigned>(std::lround(trials * probability_harder(function, stimulus_n_m)));
    counts.push_back({stimulus_n_m, harder, trials - harder});
  }
  return counts;
}

TEST(Fit, ReproducesThePapersLeastSquaresToTheDigits) {
  const FitOptions least_squares{FitMethod::kLeastSquares, 0};
  const Fit perfect = fit_weibull(perfect_stiffness_answers(), least_squares);
  EXPECT_TRUE(perfect.converged);
  EXPECT_FALSE(perfect.at_limit);
  EXPECT_NEAR(perfect.function.alpha_n_m, 32.571, kPrintedDigit);
  EXPECT_NEAR(perfect.function.beta, 8.911, kPrintedDigit);
  EXPECT_NEAR(weber_fraction(perfect.function, kBackgroundNM), 0.408, kPrintedDigit);
  const Fit kalman = fit_weibull(kalman_answers(), least_squares);
  EXPECT_NEAR(kalman.function.alpha_n_m, 27.033, kPrintedDigit);
  EXPECT_NEAR(kalman.function.beta, 5.080, kPrintedDigit);
  EXPECT_NEAR(weber_fraction(kalman.function, kBackgroundNM), 0.239, kPrintedDigit);
}

TEST(Fit, NothingNearbyFitsBetter) {
  for (const FitMethod method : {FitMethod::kLeastSquares, FitMethod::kMaximumLikelihood}) {
    const auto cost = [&](const Weibull& function) {
      double sum = 0;
      for (const StimulusCount& c : perfect_stiffness_answers()) {
        const double p = probability_harder(function, c.stimulus_n_m);
        sum += method == FitMethod::kLeastSquares
                   ? std::pow(p - c.share_harder(), 2)
                   : -(c.harder * std::log(p) + c.not_harder * std::log(1 - p));
      }
      return sum;
    };
    const Fit fit = fit_weibull(perfect_stiffness_answers(), {method, 0});
    EXPECT_NEAR(fit.cost, cost(fit.function), 1e-12 * fit.cost);
    for (const double alpha_step : {-1e-3, 0.0, 1e-3})
      for (const double beta_step : {-1e-3, 0.0, 1e-3})
        EXPECT_LE(fit.cost,
                  cost({fit.function.alpha_n_m * (1 + alpha_step), fit.function.beta * (1 + beta_step), 0}) *
                      (1 + 1e-12))
            << name_of(method);
  }
}

TEST(Fit, FindsAKnownFunctionAgain) {
  for (const double weber : {0.1, 0.2, 0.4}) {
    const Weibull truth = psychometric_function({weber, 0, 0.05}, kBackgroundNM);
    for (const FitMethod method : {FitMethod::kLeastSquares, FitMethod::kMaximumLikelihood}) {
      const Fit fit = fit_weibull(answers_of(truth, 100000), {method, 0});
      EXPECT_NEAR(fit.function.alpha_n_m, truth.alpha_n_m, 1e-3 * truth.alpha_n_m) << name_of(method);
      EXPECT_NEAR(fit.function.beta, truth.beta, 2e-3 * truth.beta) << name_of(method);
    }
  }
}

TEST(Fit, ALapseRateIsFoundAndDoesNotWidenTheWeberFraction) {
  const Weibull truth = psychometric_function({0.2, 0.06, 0}, kBackgroundNM);
  const auto counts = answers_of(truth, 100000);
  const Fit with = fit_weibull(counts, {FitMethod::kMaximumLikelihood, 0.1});
  EXPECT_NEAR(with.function.lapse_rate, 0.06, 1e-3);
  EXPECT_NEAR(weber_fraction(with.function, kBackgroundNM), 0.2, 1e-3);
  const Fit without = fit_weibull(counts, {FitMethod::kMaximumLikelihood, 0});
  EXPECT_GE(weber_fraction(without.function, kBackgroundNM), 0.21) << "lapses left out must be felt";
}

TEST(Fit, ScalingEveryStimulusScalesAlphaAlone) {
  auto counts = perfect_stiffness_answers();
  for (StimulusCount& count : counts) count.stimulus_n_m *= 1000;
  const Fit fit = fit_weibull(counts, {FitMethod::kLeastSquares, 0});
  EXPECT_NEAR(fit.function.alpha_n_m, 32571, 0.5);
  EXPECT_NEAR(fit.function.beta, 8.911, kPrintedDigit);
}

// However many stimuli and trials: all slopes from some on fit a step alike, so none is an answer.
TEST(Fit, AStepBoundsNoSlope) {
  const std::vector<std::vector<StimulusCount>> all{
      {{20, 0, 10}, {30, 10, 0}},
      {{30, 40, 0}, {29, 0, 40}},
      {{20, 0, 10}, {25, 0, 10}, {30, 10, 0}, {35, 10, 0}},
      {{20, 0, 10}, {25, 0, 10}, {30, 4, 6}, {35, 10, 0}, {40, 10, 0}},
      {{20, 0, 10}, {30, 7, 3}}};
  for (const auto& counts : all)
    for (const FitOptions& how :
         {FitOptions{FitMethod::kLeastSquares, 0}, FitOptions{FitMethod::kMaximumLikelihood, 0},
          FitOptions{FitMethod::kMaximumLikelihood, 0.1}}) {
      EXPECT_TRUE(fit_weibull(counts, how).at_limit) << name_of(how.method) << " " << counts.size();
    }
  EXPECT_FALSE(fit_weibull({{20, 0, 10}, {25, 1, 9}, {30, 4, 6}, {35, 10, 0}}).at_limit);
}

TEST(Fit, AnswersThatDoNotBoundTheCurveSaySo) {
  const Fit step = fit_weibull({{20, 0, 10}, {25, 0, 10}, {30, 10, 0}}, {FitMethod::kLeastSquares, 0});
  EXPECT_TRUE(std::isfinite(step.function.alpha_n_m) && std::isfinite(step.function.beta));
  EXPECT_GE(step.function.alpha_n_m, 25);
  EXPECT_LE(step.function.alpha_n_m, 30);
  const Fit falling = fit_weibull({{20, 9, 1}, {25, 5, 5}, {30, 1, 9}});
  EXPECT_TRUE(falling.at_limit);
}

TEST(Fit, WhatCannotBeFittedIsRefusedByName) {
  const auto message = [](const std::vector<StimulusCount>& counts, const FitOptions& options) {
    try {
      fit_weibull(counts, options);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const FitOptions plain;
  EXPECT_NE(message({{25, 1, 1}}, plain).find("two stimuli"), std::string::npos);
  EXPECT_NE(message({{25, 1, 1}, {30, 0, 0}}, plain).find("two stimuli"), std::string::npos);
  EXPECT_NE(message({{25, 4, 0}, {30, 5, 0}}, plain).find("same"), std::string::npos);
  EXPECT_NE(message({{25, 0, 4}, {30, 0, 5}}, plain).find("same"), std::string::npos);
  EXPECT_NE(message({{0, 1, 4}, {30, 4, 1}}, plain).find("stimulus_n_m"), std::string::npos);
  EXPECT_NE(message({{NAN, 1, 4}, {30, 4, 1}}, plain).find("stimulus_n_m"), std::string::npos);
  const auto answers = perfect_stiffness_answers();
  EXPECT_NE(message(answers, {FitMethod::kMaximumLikelihood, 0.7}).find("lapse_rate_max"), std::string::npos);
  EXPECT_NE(message(answers, {FitMethod::kLeastSquares, 0.1}).find("lapse_rate_max"), std::string::npos);
}

}  // namespace
}  // namespace teletact::client
