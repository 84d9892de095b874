// What sampled laws claim where a model fails amid its tissue, and in what order they come; of a model whose
// energy is written down here.
#include "service/contact/law_sampler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <stdexcept>

namespace teletact::service {
namespace {

constexpr double kEndM = 0.06, kNearM = 0.02;

// U = k d^2.4, k = 50 (1 + bumps sin(x / wave) cos(turns ln d)).
struct Written final : TouchedLayer {
  enum class Answer { kGood, kThrows, kNotConverged };
  std::function<Answer(double x_m, double d_m)> gives = [](double, double) { return Answer::kGood; };
  double bumps = 0.1, wave_m = 0.01, turns = 0, node_m = 0;
  std::array<double, 2> spacing_m(double) const override { return {node_m, 0}; }
  ContactAnswer answer(const Fingertip&, const TouchPose& pose) override {
    const double x = pose.position_m[0], d = pose.position_m[1];
    if (gives(x, d) == Answer::kThrows) throw std::out_of_range("here it cannot be touched");
    const double along = bumps * std::sin(x / wave_m), by_along = bumps / wave_m * std::cos(x / wave_m);
    const double turn = std::cos(turns * std::log(d)), by_turn = -turns * std::sin(turns * std::log(d));
    const double u = 50 * std::pow(d, 2.4), k = 1 + along * turn;
    ContactAnswer a;
    a.solve.converged = gives(x, d) == Answer::kGood;
    a.energy_j = u * k;
    a.force_n = {-u * by_along * turn, -u / d * (2.4 * k + along * by_turn), 0};
    a.tangent_n_m[1] = -u / d * by_along * (2.4 * turn + by_turn);
    return a;
  }
  double force_n(double x, double d) {
    const ContactAnswer a = answer({}, {{x, d, 0}});
    return std::hypot(a.force_n[0], a.force_n[1]);
  }
};

struct Sampled {
  std::shared_ptr<Written> model = std::make_shared<Written>();
  std::vector<LawColumn> columns(const Fingertip& tip = {}) const {
    LawSampler sampler(model, {}, tip, 0, kEndM, kNearM);
    EXPECT_TRUE(sampler.advance(LawSampler::Clock::time_point::max()));
    return sampler.columns();
  }
};

TEST(LawSampler, StatesLittleWhereLittleIsWrong) {
  const Sampled sampled;
  const auto columns = sampled.columns();
  for (double x = 0; x <= kEndM; x += 7e-4)
    for (const double d : {2e-4, 1e-3, 7e-3}) {
      const LawValue value = evaluate(columns, x, d);
      ASSERT_TRUE(value.covered && !value.beyond);
      const ContactAnswer exact = sampled.model->answer({}, {{x, d, 0}});
      const double off_n = std::hypot(value.by_x_n + exact.force_n[0], value.by_d_n + exact.force_n[1]);
      EXPECT_LE(off_n, value.error_n);
      EXPECT_LE(value.error_n, 2 * (0.005 * sampled.model->force_n(x, d) + 1e-3));
    }
}

// Nothing of it is at a column, nor at a row's depth: only the poses that are tried see it.
TEST(LawSampler, EndsAboveWhatTheModelCannotAnswerBetweenColumns) {
  Sampled sampled;
  const auto clean = sampled.columns();
  const auto right = std::find_if(clean.begin(), clean.end(), [](const auto& c) { return c.x_m > 0.035; });
  const double begin_m = (right - 1)->x_m, end_m = right->x_m;
  for (const auto failure : {Written::Answer::kThrows, Written::Answer::kNotConverged}) {
    sampled.model->gives = [=](double x, double d) {
      return x > begin_m + 1e-4 && x < end_m - 1e-4 && d > 3e-3 && d < 7.9e-3 ? failure
                                                                              : Written::Answer::kGood;
    };
    const auto columns = sampled.columns();
    for (double x = begin_m + 2e-4; x < end_m - 2e-4; x += 3e-4) {
      EXPECT_TRUE(evaluate(columns, x, 5e-3).beyond) << x;
      EXPECT_FALSE(evaluate(columns, x, 2.6e-3).beyond) << x;
    }
    EXPECT_FALSE(evaluate(columns, 0.01, 5e-3).beyond);
  }
}

TEST(LawSampler, ClaimsNothingWhereNothingCouldBeTried) {
  Sampled sampled;
  const auto clean = sampled.columns();
  const auto right = std::find_if(clean.begin(), clean.end(), [](const auto& c) { return c.x_m > 0.035; });
  const double begin_m = (right - 1)->x_m, end_m = right->x_m;
  sampled.model->gives = [=](double x, double) {
    return x > begin_m + 1e-4 && x < end_m - 1e-4 ? Written::Answer::kThrows : Written::Answer::kGood;
  };
  const auto columns = sampled.columns();
  const double middle_m = (begin_m + end_m) / 2;
  const LawValue amid = evaluate(columns, middle_m, 2e-3);
  EXPECT_GE(amid.error_n, std::hypot(amid.by_x_n, amid.by_d_n));
  const LawValue elsewhere = evaluate(columns, 0.01, 2e-3);
  EXPECT_LE(elsewhere.error_n, 0.02 * std::hypot(elsewhere.by_x_n, elsewhere.by_d_n) + 2e-3);
}

TEST(LawSampler, HasNoLawWhereTheModelNeverAnswers) {
  Sampled sampled;
  sampled.model->gives = [](double, double) { return Written::Answer::kThrows; };
  EXPECT_TRUE(sampled.columns().empty());
}

// Ripples of a millimetre are finer than any column: what they are is said.
TEST(LawSampler, StatesTheRipplesThatItCannotFollow) {
  Sampled sampled;
  sampled.model->bumps = 0.02, sampled.model->wave_m = 0.001 / 6.28;
  const auto columns = sampled.columns();
  std::size_t poses = 0, off = 0;
  for (double x = 1e-4; x < kEndM; x += 1.7e-4) {
    const LawValue value = evaluate(columns, x, 3e-3);
    const ContactAnswer exact = sampled.model->answer({}, {{x, 3e-3, 0}});
    off += std::hypot(value.by_x_n + exact.force_n[0], value.by_d_n + exact.force_n[1]) > value.error_n;
    ++poses;
  }
  EXPECT_LE(double(off), 0.02 * double(poses));
}

// Its slopes at a column are carried over the whole cell: samples are averaged over it.
TEST(LawSampler, FollowsNoRippleOfTheMeshThatIsWithinTheTolerance) {
  Sampled sampled;
  const std::size_t smooth = Sampled().columns().size();
  sampled.model->bumps = 7.7e-4, sampled.model->wave_m = 0.0008 / 6.2832, sampled.model->turns = 10;
  EXPECT_GT(sampled.columns().size(), smooth + 2) << "a ripple that nobody told of";
  sampled.model->node_m = 0.0008;
  const auto columns = sampled.columns();
  EXPECT_EQ(columns.size(), smooth);
  for (const double d : {5e-4, 1e-3, 2e-3, 3e-3, 4e-3})  // deeper this ripple is more than the tolerance
    for (double x = 1e-4; x < kEndM; x += 1.7e-4) {
      const LawValue value = evaluate(columns, x, d);
      const ContactAnswer exact = sampled.model->answer({}, {{x, d, 0}});
      EXPECT_LE(std::hypot(value.by_x_n + exact.force_n[0], value.by_d_n + exact.force_n[1]),
                0.005 * sampled.model->force_n(x, d) + 1e-3);
    }
}

TEST(LawSampler, ShowsNearColumnsFirstAndKeepsThem) {
  const Sampled sampled;
  LawSampler sampler(sampled.model, {}, {}, 0, kEndM, kNearM);
  std::vector<LawColumn> before;
  for (bool done = false; !done;) {
    done = sampler.advance({});
    const std::vector<LawColumn> shown = sampler.columns();
    if (shown.empty()) continue;
    if (before.empty()) {
      EXPECT_LE(shown.front().x_m, kNearM);
      EXPECT_GE(shown.back().x_m, kNearM);
    }
    const auto same = [](const LawColumn& one, const LawColumn& other) {
      return one.x_m == other.x_m && one.rows == other.rows && one.error_n == other.error_n &&
             std::memcmp(one.samples.data(), other.samples.data(), one.rows * sizeof(LawSample)) == 0;
    };
    EXPECT_NE(std::search(shown.begin(), shown.end(), before.begin(), before.end(), same), shown.end());
    before = shown;
  }
  EXPECT_EQ(before.front().x_m, 0);
  EXPECT_EQ(before.back().x_m, kEndM);
}

TEST(LawSampler, AStuckTipsLawEndsAtFourMillimetres) {
  const auto columns = Sampled().columns({.friction = Friction::kStuck});
  EXPECT_FALSE(evaluate(columns, 0.03, 3.9e-3).beyond);
  EXPECT_TRUE(evaluate(columns, 0.03, 4.1e-3).beyond);
}

}  // namespace
}  // namespace teletact::service
