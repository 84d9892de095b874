// What goes in and what comes back, by sum F.dx alone, when laws come, change and end under a pressed finger.
// Nothing is dissipated by the display, so nothing may be had.
#include <gtest/gtest.h>

#include <deque>
#include <optional>
#include <vector>

#include "client/render/force_chain.h"
#include "client/render/law_renderer.h"
#include "tests/render/tissue_law.h"

namespace teletact::client {
namespace {

using test::AnalyticTissue;

constexpr double kTickS = 0.001;
constexpr double kInclusionM = 0.03, kBesideM = 0.055;

AnalyticTissue tissue_of(double contrast) {
  return {.inclusions = {{kInclusionM, contrast, 0.006}}};
}

// A finger that goes where it is told. Work is by the mean force of two ticks over each step: what a force
// held between them gives (K T/2) is left out.
class Loop {
 public:
  explicit Loop(const LawRendererOptions& options = {}) : renderer_(options) {}
  void law(const NearLaw& law) { renderer_.take_law(law); }
  // Answers 20 times a second, `late` ticks late; of no window with version 0.
  void answers(const AnalyticTissue& tissue, std::uint64_t version, std::size_t late = 100) {
    tissue_ = tissue, version_ = version, late_ = late;
  }
  void hold(double seconds, double dissipated_j = 0) { move(x_, d_, seconds, dissipated_j); }
  void move(double to_x, double to_d, double seconds, double dissipated_j = 0) {
    const int ticks = std::max(int(std::lround(seconds / kTickS)), 1);
    const double from_x = x_, from_d = d_;
    for (int k = 1; k <= ticks; ++k) {
      const double was_x = x_, was_d = d_;
      x_ = from_x + (to_x - from_x) * k / ticks, d_ = from_d + (to_d - from_d) * k / ticks;
      tick(dissipated_j);
      const Vector3 mean_n = (last_.force_n + now_.force_n) / 2;
      in_j_ -= mean_n.x() * (x_ - was_x) + mean_n.y() * (d_ - was_d);
      dissipated_j_ += dissipated_j;
      held_j_ = std::max(held_j_, in_j_);
      if (d_ > 0) short_j_ = std::max(short_j_, now_.stored_j + ledger_.balance_j() - in_j_ - dissipated_j_);
      if (ledger_.balance_j() < -1e-12) short_j_ = 1;
    }
  }
  // At rest: the largest change within 10 ms, beyond 2 mN, of the force at their beginning or of `of_n`.
  double hold_watched(double seconds, double of_n = 0) {
    double largest = 0;
    std::deque<Vector3> forces;
    for (double t = 0; t < seconds; t += kTickS) {
      hold(kTickS);
      forces.push_back(now_.force_n);
      if (forces.size() > 11) forces.pop_front();
      const double change_n = (forces.back() - forces.front()).norm() - 0.002;
      largest = std::max(largest, change_n / std::max(of_n, forces.front().norm()));
    }
    return largest;
  }
  const LawRenderer& renderer() const { return renderer_; }
  EnergyLedger& ledger() { return ledger_; }
  const Rendered& now() const { return now_; }
  double time_s() const { return time_s_; }
  double in_j() const { return in_j_; }  // put in and not given back
  double dissipated_j() const { return dissipated_j_; }
  double held_j() const { return held_j_; }  // most that was
  // Most that it said to hold and to have earned, beyond what was put in and dissipated.
  double short_j() const { return short_j_; }

 private:
  void tick(double dissipated_j) {
    time_s_ += kTickS;
    path_.push_back({x_, d_, 0});
    if (path_.size() % 50 == 0) {
      ForceSample sample = tissue_.told(path_[path_.size() - 1 - std::min(late_, path_.size() - 1)],
                                        time_s_ - kTickS * double(late_), ++sequence_);
      sample.model_version = version_;
      if (version_ == 0) sample.contact = false, sample.foreseen = false, sample.force_n.setZero();
      renderer_.update(sample, {{x_, d_, 0}, Vector3::Zero()}, time_s_);
    }
    last_ = now_;
    if (!(d_ > 0)) ledger_.reset();
    ledger_.earn(dissipated_j);
    now_ = renderer_.render({{x_, d_, 0}, Vector3::Zero()}, time_s_, ledger_);
  }

  LawRenderer renderer_;
  EnergyLedger ledger_;
  AnalyticTissue tissue_;
  std::uint64_t version_ = 0, sequence_ = 0;
  std::size_t late_ = 0;
  double x_ = kInclusionM + 0.005, d_ = -0.001, time_s_ = 0;
  std::vector<Vector3> path_;
  Rendered now_, last_;
  double in_j_ = 0, dissipated_j_ = 0, held_j_ = 0, short_j_ = 0;
};

// Of what was held: a step's work is by the mean force of two ticks, while a blend goes on at the second.
constexpr double kRounding = 6e-3;

// What is dissipated while answers alone are felt pays for their changes, and not again for a law that comes.
TEST(LawLedger, WhatIsDissipatedPaysOnce) {
  Loop loop;
  loop.answers(tissue_of(1), 1, 0);
  loop.hold(0.2);
  loop.move(kInclusionM + 0.005, 0.004, 0.1);
  loop.answers(tissue_of(4), 1, 0);  // of the same version: the filter's to pay
  loop.hold(1, 2e-6);
  loop.answers(tissue_of(8), 2, 0);
  loop.law(test::law_of(tissue_of(8), 2, -0.02, 0.07));
  loop.hold(1);
  loop.move(kInclusionM + 0.005, -0.001, 0.1);
  EXPECT_GT(loop.in_j() + loop.dissipated_j(), -kRounding * loop.held_j());
}

TEST(LawLedger, OfAForceThatIsTakenOnlyWhatIsLeftEarns) {
  for (const double gain : {1.0, 0.25, 0.0}) {
    Loop loop;
    loop.answers(tissue_of(4), 1);
    loop.law(test::law_of(tissue_of(4), 1, -0.02, 0.07));
    loop.hold(0.2);
    loop.move(kInclusionM + 0.005, 0.004, 0.1);
    loop.ledger().set_gain(gain);
    const double held_j = loop.now().stored_j;
    loop.answers(tissue_of(1), 2);
    loop.law(test::law_of(tissue_of(1), 2, -0.02, 0.07));
    loop.hold(1);
    ASSERT_LT(loop.now().stored_j, 0.8 * held_j);
    EXPECT_NEAR(loop.ledger().balance_j(), gain * (held_j - loop.now().stored_j), 0.01 * held_j) << gain;
  }
}

// Pressed, another law, slid off and on again while that is blended in, and lifted.
TEST(LawLedger, ChangeOfLawUnderAFingerGivesNoEnergy) {
  for (const double max_n :
       {3.3, 0.35})  // the second is reached, where a harder law holds more at the same force
    for (const double stiffest_n_m : {700.0, 150.0})
      for (const double from : {1.0, 2.0, 4.0})
        for (const double to : {1.0, 2.0, 4.0}) {
          if (from == to) continue;
          Loop loop({.largest_force_n = max_n, .largest_stiffness_n_m = stiffest_n_m});
          const auto now_is = [&](double contrast, std::uint64_t version) {
            loop.answers(tissue_of(contrast), version);
            loop.law(test::law_of(tissue_of(contrast), version, -0.02, 0.07));
          };
          now_is(from, 1);
          loop.hold(0.2);
          loop.move(kInclusionM + 0.005, 0.004, 0.1);
          now_is(to, 2);
          EXPECT_LT(loop.hold_watched(0.03), 0.07);
          loop.move(kInclusionM - 0.005, 0.004, 0.08);
          now_is(from, 3);
          loop.move(kInclusionM + 0.005, 0.004, 0.08);
          now_is(to, 4);
          loop.hold(0.02, 1e-6);
          loop.move(kInclusionM + 0.010, -0.001, 0.05);
          EXPECT_TRUE(loop.now().by_law);
          EXPECT_GT(loop.in_j() + loop.dissipated_j(), -kRounding * loop.held_j())
              << max_n << ' ' << from << ' ' << to;
          EXPECT_LT(loop.short_j(), kRounding * loop.held_j()) << max_n << ' ' << from << ' ' << to;
        }
}

// From a law to answers alone and back, by the borders of what the law covers.
TEST(LawLedger, BorderOfCoverageGivesNoMoreThanAnswers) {
  for (const double border : {0.030, 0.034, 0.038, 0.046})
    for (const bool out : {true, false}) {
      Loop loop;
      loop.answers(tissue_of(1), 1, 10);
      loop.law(test::law_of(tissue_of(1), 1, -0.02, border));
      const double begin = out ? 0.025 : kBesideM, end = out ? kBesideM : 0.025;
      loop.move(begin, -0.001, 0.2);
      loop.move(begin, 0.003, 0.1);
      EXPECT_EQ(loop.now().by_law, out);
      loop.move(end, 0.003, 0.25);
      loop.move(end, -0.001, 0.05);
      EXPECT_EQ(loop.now().by_law, !out);
      EXPECT_GT(loop.in_j(), -kRounding * loop.held_j()) << border << out;
    }
}

// Windows that go, and tissue that no window covers: the force ends in a fifth of a second, and gives
// nothing.
TEST(LawLedger, EndOfTissueTakesTheForceGradually) {
  Loop loop;
  loop.answers(tissue_of(3), 1);
  loop.law(test::law_of(tissue_of(3), 1, -0.02, 0.07));
  loop.hold(0.2);
  loop.move(kInclusionM + 0.005, 0.004, 0.1);
  loop.answers(tissue_of(3), 0, 0);
  EXPECT_LT(loop.hold_watched(0.12, loop.now().force_n.norm()), 0.07);
  EXPECT_GT(loop.now().force_n.norm(), 0);
  loop.hold(0.13);
  EXPECT_EQ(loop.now().force_n.norm(), 0);
  EXPECT_FALSE(loop.now().by_law);
  loop.move(kInclusionM + 0.005, -0.001, 0.1);
  EXPECT_GT(loop.in_j(), 0);
}

// Off by more than it states in four answers running: not rendered any more within 50 ms of the fourth, and
// the filter's model takes over, paid for.
TEST(LawLedger, FilterReplacesAWrongLawWithinTheLedger) {
  for (const double is : {1.0, 4.0}) {
    Loop loop;
    loop.answers(tissue_of(2), 1, 0);
    loop.law(test::law_of(tissue_of(2), 1, -0.02, 0.07));
    loop.hold(0.2);
    loop.move(kInclusionM + 0.005, 0.004, 0.1);
    loop.answers(tissue_of(is), 1, 0);
    const double before_n = loop.now().force_n.norm();
    const double begun_s = loop.time_s();
    while (loop.renderer().dropped() == 0 && loop.time_s() < begun_s + 1) loop.hold(kTickS);
    EXPECT_NEAR(loop.time_s() - begun_s, 4 * 0.05, 0.002);  // the fourth
    double by_law_s = 0;
    for (int k = 0; k < 50; ++k, loop.hold(kTickS)) by_law_s += loop.now().by_law ? kTickS : 0;
    EXPECT_LE(by_law_s, 0.05);
    EXPECT_LT(loop.hold_watched(0.4), 0.07);
    const double now_n = loop.now().force_n.norm();
    const double true_n = tissue_of(is).answer({kInclusionM + 0.005, 0.004, 0}).force_n.norm();
    if (is < 2) {
      EXPECT_NEAR(now_n, true_n, 0.02 * true_n);
    } else {
      EXPECT_NEAR(now_n, before_n, 0.02 * before_n);  // nothing has paid for more
      loop.hold(0.6, 1e-5);
      EXPECT_NEAR(loop.now().force_n.norm(), true_n, 0.02 * true_n);
    }
    EXPECT_LT(loop.short_j(), 0.05 * loop.held_j());  // what the filter holds is an estimate
  }
}

// A spring through the safety chain, answered or not.
class Chained {
 public:
  Chained() {
    ForceChainOptions options;
    options.limits.friction_n = 1e-9;  // states that it dissipates next to nothing
    chain_.emplace(options);
  }
  double move(double to_d, double seconds, double silence_begin_s, double silence_end_s, bool by_law) {
    const int ticks = std::max(int(std::lround(seconds / kTickS)), 1);
    const double from_d = d_;
    double largest = 0;
    for (int k = 1; k <= ticks; ++k) {
      const double was_d = d_, was_n = out_.force_n.norm();
      d_ = from_d + (to_d - from_d) * k / ticks;
      ForceChainInput input;
      const double in = std::max(d_, 0.0);
      input.rendered.force_n = {0, -kStiffnessNM * in, 0};
      input.rendered.stored_j = kStiffnessNM * in * in / 2;
      input.rendered.by_law = by_law;
      input.pose = {{0, d_, 0}, {0, (d_ - was_d) / kTickS, 0}};
      input.on = true;
      input.enabled_s = 1;
      input.silence_s = silence_begin_s + (silence_end_s - silence_begin_s) * k / ticks;
      input.model_age_s = by_law ? 0 : input.silence_s + 0.1;
      input.period_s = 0.05;
      out_ = chain_->apply(input);
      in_j_ += (was_n + out_.force_n.norm()) / 2 * (d_ - was_d);
      held_j_ = std::max(held_j_, in_j_);
      EXPECT_GE(out_.balance_j, -1e-12);
      if (was_d == d_) largest = std::max(largest, std::abs(out_.force_n.norm() - was_n));
    }
    return largest;
  }
  double force_n() const { return out_.force_n.norm(); }
  const ForceChainOutput& out() const { return out_; }
  double in_j() const { return in_j_; }
  double held_j() const { return held_j_; }

 private:
  static constexpr double kStiffnessNM = 300;
  std::optional<ForceChain> chain_;
  ForceChainOutput out_;
  double d_ = -0.001, in_j_ = 0, held_j_ = 0;
};

// Faded, pressed deeper for little, and answered again.
TEST(LawLedger, FadedForceReturnsAtWhatItWasGivenUpFor) {
  for (const double stalled_s : {0.2, 0.38, 0.44}) {
    Chained touch;
    touch.move(0.003, 0.1, 0, 0, true);
    touch.move(0.003, 0.2, 0, stalled_s, true);
    touch.move(0.006, 0.01, stalled_s, stalled_s + 0.01, true);
    touch.move(0.006, 0.3, 0, 0, true);
    EXPECT_GT(touch.force_n(), 0.3);
    touch.move(-0.001, 0.1, 0, 0, true);
    EXPECT_GT(touch.in_j(), -kRounding * touch.held_j()) << stalled_s;
  }
}

TEST(LawLedger, AForceOfAnswersThatFadedInAStallIsPaidForToo) {
  Chained touch;
  touch.move(0.003, 0.1, 0, 0, false);
  touch.move(0.003, 0.2, 0, 0.14, false);
  touch.move(0.006, 0.01, 0.14, 0.15, false);
  touch.move(0.006, 0.001, 0, 0, false);
  EXPECT_EQ(touch.out().refused.who, EnergyClaim::kSilence);
  EXPECT_GT(touch.out().refused.lacks_j, 0);
  touch.move(0.006, 0.3, 0, 0, false);
  EXPECT_GT(touch.force_n(), 0.3);
  touch.move(-0.001, 0.1, 0, 0, false);
  EXPECT_GT(touch.in_j(), -kRounding * touch.held_j());
}

TEST(LawLedger, UnpaidForceIsSaidAndWholeWhenPressedAnew) {
  Chained touch;
  touch.move(0.003, 0.1, 0, 0, true);
  touch.move(0.003, 0.4, 0, 0.42, true);
  touch.move(0.006, 0.01, 0.42, 0.43, true);
  touch.move(0.006, 0.2, 0, 0, true);
  EXPECT_LT(touch.force_n(), 0.8 * 1.8);
  EXPECT_TRUE(touch.out().withholds);
  touch.move(-0.001, 0.1, 0, 0, true);
  touch.move(0.006, 0.1, 0, 0, true);  // pressed anew
  EXPECT_NEAR(touch.force_n(), 1.8, 1e-9);
  EXPECT_FALSE(touch.out().withholds);
}

TEST(LawLedger, ALawThatEndsInAStallDoesNotStep) {
  for (const double ends_s : {0.1, 0.2, 0.3, 0.4}) {
    Chained touch;
    touch.move(0.003, 0.1, 0, 0, true);
    touch.move(0.003, ends_s, 0, ends_s, true);
    const double before_n = touch.force_n();
    const double left_s = 0.5 - ends_s;
    EXPECT_LT(touch.move(0.003, left_s, ends_s, 0.5, false), 0.007 * 0.9) << ends_s;
    EXPECT_GT(before_n, 0);
    EXPECT_EQ(touch.force_n(), 0) << ends_s;
  }
}

}  // namespace
}  // namespace teletact::client
