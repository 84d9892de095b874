#include "client/render/kalman_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <limits>
#include <random>

#include "tests/render/analytic_tissue.h"

namespace teletact::client {
namespace {

using test::AnalyticTissue;

ToolPose at(double x_m, double y_m) {
  return {Vector3(x_m, y_m, 0), Vector3::Zero()};
}

ForceSample spring(double k_n_m, double indentation_m, double time_s) {
  ForceSample sample;
  sample.contact = true;
  sample.pose_time_s = time_s;
  sample.position_m = Vector3(0, indentation_m, 0);
  sample.force_n = Vector3(0, -k_n_m * indentation_m, 0);
  sample.tangent_n_m(1, 1) = -k_n_m;
  return sample;
}

struct SweepErrors {
  std::vector<double> relative;
  double percentile(double share) {
    std::sort(relative.begin(), relative.end());
    return relative.empty() ? std::numeric_limits<double>::quiet_NaN()
                            : relative[static_cast<std::size_t>(share * double(relative.size() - 1))];
  }
};

// A finger at 120 mm/s over three inclusions, its depth swaying, answers every `period_s` that are `delay_s`
// old.
SweepErrors sweep(Renderer& renderer, double period_s, double delay_s) {
  const AnalyticTissue tissue;
  const auto position = [](double t) {
    return Vector3(0.01 + 0.12 * t, 0.004 + 0.0005 * std::sin(9 * t), 0);
  };
  SweepErrors errors;
  double next_s = 0;
  std::deque<ForceSample> on_the_way;
  for (double t = 0; t < 0.9; t += 0.001) {
    if (t >= next_s) {
      on_the_way.push_back(tissue.answer(position(t), t));
      next_s += period_s;
    }
    while (!on_the_way.empty() && on_the_way.front().pose_time_s + delay_s <= t) {
      renderer.update(on_the_way.front(), {position(t), Vector3::Zero()}, t);
      on_the_way.pop_front();
    }
    const Vector3 felt = renderer.render({position(t), Vector3::Zero()}, t).force_n;
    const Vector3 truth = tissue.answer(position(t)).force_n;
    if (t > 0.1) errors.relative.push_back((felt - truth).norm() / truth.norm());
  }
  return errors;
}

TEST(KalmanRenderer, FollowsInclusionsAtExploringSpeed) {
  for (const double rate_hz : {200.0, 300.0, 500.0}) {
    KalmanRenderer kalman;
    SweepErrors errors = sweep(kalman, 1 / rate_hz, 0.004);
    EXPECT_LE(errors.percentile(0.5), 0.015) << rate_hz;
    EXPECT_LE(errors.percentile(0.95), 0.05) << rate_hz;
    EXPECT_LE(errors.percentile(1), 0.10) << rate_hz;
  }
}

// Beside an inclusion, half a millimetre further than any answer: deeper, less deep, to either side.
TEST(KalmanRenderer, OneAnswerTellsTheForceAroundIt) {
  const AnalyticTissue tissue;
  const Vector3 answered(0.055, 0.004, 0);
  for (const Vector3& step :
       {Vector3(0, 5e-4, 0), Vector3(0, -5e-4, 0), Vector3(5e-4, 0, 0), Vector3(-5e-4, 0, 0)}) {
    KalmanRenderer kalman;
    const ForceSample here = tissue.answer(answered);
    kalman.update(here, {answered, Vector3::Zero()}, 0);
    const Vector3 felt = kalman.render({answered + step, Vector3::Zero()}, 1).force_n;
    const Vector3 truth = tissue.answer(answered + step).force_n;
    // Held as it is, the stiffness would miss by more than twice as much.
    const Vector3 held = here.force_n * (answered + step).y() / answered.y();
    EXPECT_LE(2 * (felt - truth).norm(), (held - truth).norm()) << step.transpose();
  }
}

TEST(KalmanRenderer, IsBetterThanForceOnly) {
  KalmanRenderer kalman;
  KalmanRenderer force_only(KalmanOptions{.use_tangent = false});
  const double with_tangent = sweep(kalman, 0.005, 0.005).percentile(0.95);
  EXPECT_LE(2 * with_tangent, sweep(force_only, 0.005, 0.005).percentile(0.95));
}

TEST(KalmanRenderer, ConvergesUnderNoiseAndStatesHowWell) {
  // GIVEN a filter told of small walk and of 2 % noise, WHEN 400 noisy answers of a spring arrive
  KalmanOptions options{.use_tangent = false,
                        .stiffness_walk_share = 0,
                        .stiffness_walk_n_m = 1,
                        .force_noise_share = 0,
                        .force_noise_n = 0.02};
  KalmanRenderer kalman(options);
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, 0.02);
  constexpr double kTrue = 250;
  for (int n = 0; n < 400; ++n) {
    ForceSample sample = spring(kTrue, 0.004, 0.01 * n);
    sample.force_n.y() += noise(random);
    kalman.update(sample, at(0, 0.004), 0.01 * n);
  }
  const Rendered rendered = kalman.render(at(0, 0.004), 100);
  // THEN the estimate is right within three of its own standard deviations, and these have shrunk
  EXPECT_LE(std::sqrt(rendered.variance), 2.0);
  EXPECT_LE(std::abs(rendered.stiffness_n_m - kTrue), 3 * std::sqrt(rendered.variance));
  EXPECT_GT(rendered.gain, 0);
  EXPECT_LE(rendered.gain, 1);
}

TEST(KalmanRenderer, PairedPosesLeaveNoBias) {
  // Answers 20 ms old while the finger moves in and out at 3 Hz, outweighing any filter of the noise.
  constexpr double kTrue = 200;
  const auto depth = [](double t) { return 0.003 + 0.002 * std::sin(2 * M_PI * 3 * t); };
  const auto rms_error = [&](bool paired) {
    KalmanRenderer kalman(KalmanOptions{.use_tangent = false});
    double sum = 0;
    int count = 0;
    for (double t = 0.1; t < 3; t += 0.01) {
      ForceSample sample = spring(kTrue, depth(t - 0.02), t - 0.02);
      if (!paired) sample.position_m.y() = depth(t);
      kalman.update(sample, at(0, depth(t)), t);
      const double k = kalman.render(at(0, depth(t)), t + 1).stiffness_n_m;
      sum += (k - kTrue) * (k - kTrue);
      ++count;
    }
    return std::sqrt(sum / count) / kTrue;
  };
  EXPECT_LE(rms_error(true), 1e-3);
  EXPECT_GT(rms_error(false), 0.1);  // the fault that pairing avoids is visible here
}

TEST(KalmanRenderer, NeverPulls) {
  KalmanRenderer kalman;
  ForceSample sample = spring(-100, 0.004, 0);
  kalman.update(sample, at(0, 0.004), 0);
  for (double t = 0; t < 0.1; t += 0.001) EXPECT_EQ(kalman.render(at(0, 0.004), t).force_n.y(), 0);
}

TEST(KalmanRenderer, NoForceOutsideTheTissue) {
  KalmanRenderer kalman;
  const AnalyticTissue tissue;
  kalman.update(tissue.answer({0.028, 0.004, 0}), at(0.028, 0.004), 0);
  EXPECT_EQ(kalman.render(at(0.028, 0), 0.01).force_n.norm(), 0);
  EXPECT_EQ(kalman.render(at(0.028, -0.001), 0.01).force_n.norm(), 0);
  // and it gets there continuously
  EXPECT_LE(kalman.render(at(0.028, 1e-6), 0.01).force_n.norm(), 1e-3);
}

TEST(KalmanRenderer, OneWildAnswerIsGatedThreeAreBelieved) {
  KalmanRenderer kalman;
  double t = 0;
  for (; t < 0.3; t += 0.003) kalman.update(spring(200, 0.004, t), at(0, 0.004), t);
  kalman.update(spring(20000, 0.004, t), at(0, 0.004), t);
  EXPECT_EQ(kalman.outliers(), 1u);
  EXPECT_NEAR(kalman.render(at(0, 0.004), t + 0.1).stiffness_n_m, 200, 1);
  for (int n = 0; n < 3; ++n) {
    t += 0.003;
    kalman.update(spring(20000, 0.004, t), at(0, 0.004), t);
  }
  EXPECT_NEAR(kalman.render(at(0, 0.004), t + 1).stiffness_n_m, 20000, 20);
}

TEST(KalmanRenderer, ForceIsContinuousAtModelUpdates) {
  for (const double after : {50.0, 160.0, 260.0, 600.0}) {
    KalmanRenderer kalman;
    double t = 0;
    for (; t < 0.3; t += 0.003) kalman.update(spring(200, 0.004, t), at(0, 0.004), t);
    double last = kalman.render(at(0, 0.004), t).force_n.norm();
    double largest = 0;
    for (int tick = 0; tick < 500; ++tick, t += 0.001) {
      // Three answers: a change this large is taken for an outlier at first.
      if (tick % 3 == 0 && tick < 9) kalman.update(spring(after, 0.004, t), at(0, 0.004), t);
      const double force = kalman.render(at(0, 0.004), t).force_n.norm();
      largest = std::max(largest, std::abs(force - last) / std::max(force, last));
      last = force;
    }
    EXPECT_LE(largest, 0.07 + 1e-9) << after;
    EXPECT_NEAR(last, after * 0.004, 0.01 * after * 0.004);
  }
}

TEST(KalmanRenderer, PressSlideReleaseDoesNoWork) {
  // Into the tissue beside an inclusion, over to it, out again; exact answers every 3 ms.
  KalmanRenderer kalman;
  const AnalyticTissue tissue;
  double work_j = 0, stored_j = 0;
  Vector3 last(0.055, 0, 0);
  double t = 0;
  const auto to = [&](const Vector3& goal, double seconds) {
    const Vector3 from = last;
    const int steps = static_cast<int>(seconds / 0.001);
    for (int n = 1; n <= steps; ++n, t += 0.001) {
      const Vector3 now = from + (goal - from) * (double(n) / steps);
      if (n % 3 == 0) kalman.update(tissue.answer(now, t), {now, Vector3::Zero()}, t);
      work_j -= kalman.render({0.5 * (now + last), Vector3::Zero()}, t).force_n.dot(now - last);
      stored_j = std::max(stored_j, work_j);
      last = now;
    }
  };
  to({0.055, 0.004, 0}, 0.2);
  to({0.060, 0.004, 0}, 0.1);
  to({0.060, 0.0, 0}, 0.2);
  EXPECT_GT(stored_j, 1e-3);
  EXPECT_LE(std::abs(work_j), 0.04 * stored_j);
}

TEST(KalmanRenderer, GivesUpADistantGradientSmoothly) {
  KalmanRenderer kalman;
  const AnalyticTissue tissue;
  const ForceSample answer = tissue.answer({0.025, 0.004, 0});
  kalman.update(answer, at(0.025, 0.004), 0);
  const auto stiffness = [&](double x_m) { return kalman.render(at(x_m, 0.004), 1).stiffness_n_m; };
  const double there = -answer.force_n.y() / 0.004;
  // the inclusion's flank: near the answer its slope is followed, 20 mm on its stiffness is all that is known
  EXPECT_GT(stiffness(0.028), 1.1 * there);
  EXPECT_NEAR(stiffness(0.045), there, 1e-6 * there);
  // nor is it pushed along there as here
  const auto sideways = [&](double x_m) {
    return kalman.render(at(x_m, 0.004), 1).lateral_stiffness_n_m.x();
  };
  EXPECT_NEAR(sideways(0.025), -answer.force_n.x() / 0.004, 0.02 * there);
  EXPECT_NEAR(sideways(0.045), 0, 1e-6 * there);
  for (double x_m = 0.005; x_m < 0.05; x_m += 1e-5)
    EXPECT_NEAR(stiffness(x_m), stiffness(x_m + 1e-5), 0.002 * there) << x_m;
}

TEST(KalmanRenderer, ForeseenTissueIsThereAtOnce) {
  KalmanRenderer kalman;
  const AnalyticTissue tissue;
  EXPECT_TRUE(kalman.update(tissue.told({0.03, -0.002, 0}), at(0.03, -0.002), 0));
  EnergyLedger none;
  EXPECT_EQ(kalman.render(at(0.03, -0.002), 0.001, none).force_n.norm(), 0);
  const Rendered first = kalman.render(at(0.03, 5e-4), 0.002, none);
  const Vector3 truth = tissue.answer({0.03, 5e-4, 0}).force_n;
  EXPECT_LE((first.force_n - truth).norm(), 0.02 * truth.norm());
  EXPECT_EQ(first.withheld, 0);
}

TEST(KalmanRenderer, LostCoverageEndsTheForceSmoothly) {
  KalmanRenderer kalman;
  for (double t = 0; t < 0.1; t += 0.001) {
    kalman.update(spring(400, 0.003, t), at(0, 0.003), t);
    kalman.render(at(0, 0.003), t);
  }
  ForceSample none;
  none.position_m = Vector3(0, 0.003, 0);
  EnergyLedger ledger;
  double last = kalman.render(at(0, 0.003), 0.1).force_n.norm();
  EXPECT_NEAR(last, 1.2, 0.02);
  for (double t = 0.1; t < 0.25; t += 0.001) {
    EXPECT_TRUE(kalman.update(none, at(0, 0.003), t));
    const double force_n = kalman.render(at(0, 0.003), t, ledger).force_n.norm();
    EXPECT_LE(last - force_n, std::max(0.07 * last, 0.006));
    last = force_n;
  }
  EXPECT_EQ(last, 0);
  // WHEN it is somewhere else THEN nothing old is felt there
  EXPECT_EQ(kalman.render(at(0.1, 0.003), 60).force_n.norm(), 0);
}

TEST(KalmanRenderer, HarderModelComesAsItIsPaidFor) {
  KalmanRenderer kalman;
  double t = 0;
  for (; t < 0.3; t += 0.003) kalman.update(spring(200, 0.004, t), at(0, 0.004), t);
  kalman.render(at(0, 0.004), t);
  EnergyLedger ledger;
  kalman.render(at(0, -0.001), t, ledger);  // lifted
  for (int n = 0; n < 4; ++n, t += 0.003) kalman.update(spring(300, 0.004, t), at(0, 0.004), t);
  const auto stiffness = [&](double paid_j) {
    t += 0.001;
    ledger.earn(paid_j);
    return kalman.render(at(0, 0.004), t, ledger).stiffness_n_m;
  };
  const double before = stiffness(0);
  for (int n = 0; n < 50; ++n) EXPECT_EQ(stiffness(0), before);
  EXPECT_LT(before, 290);
  KalmanRenderer lifted = kalman;
  lifted.render(at(0, -0.001), t, ledger);
  EXPECT_NEAR(lifted.render(at(0, 0.004), t, ledger).stiffness_n_m, 300, 1);  // anew: as it is
  const double half_square = 0.5 * 0.004 * 0.004;
  EXPECT_NEAR(stiffness(5 * half_square), before + 5, 0.01);  // 5 N/m are paid for
  stiffness(1e-3);
  for (int n = 0; n < 50; ++n) stiffness(0);
  EXPECT_NEAR(stiffness(0), 300, 1);
}

TEST(KalmanRenderer, AnOutlierIsNoNewKnowledge) {
  KalmanRenderer kalman;
  for (double t = 0; t < 0.3; t += 0.003) EXPECT_TRUE(kalman.update(spring(200, 0.004, t), at(0, 0.004), t));
  EXPECT_FALSE(kalman.update(spring(20000, 0.004, 0.303), at(0, 0.004), 0.303));
  EXPECT_TRUE(kalman.update(spring(200, 0.004, 0.306), at(0, 0.004), 0.306));
}

}  // namespace
}  // namespace teletact::client
