// What the renderer of the whole chain is told of a spring: how often, how late, and nothing new under a
// finger.
#include "client/experiment/spring_answers.h"

#include <gtest/gtest.h>

#include <vector>

namespace teletact::client {
namespace {

constexpr std::int64_t kMs = 1000000;

ServoPose at(double y_m, std::int64_t ms) {
  return {{{0.01, y_m, 0}, Vector3::Zero()}, ms * kMs};
}

SpringTissue everywhere(double stiffness_n_m) {
  return {.background_n_m = 25, .stimulus_n_m = stiffness_n_m};
}

// A pose and a look for answers every millisecond.
std::vector<ServoAnswer> run(SpringAnswers& answers, double y_m, std::int64_t begin_ms, std::int64_t end_ms) {
  std::vector<ServoAnswer> come;
  for (std::int64_t ms = begin_ms; ms < end_ms; ++ms) {
    answers.add(at(y_m, ms));
    if (const auto answer = answers.take(ms * kMs)) come.push_back(*answer);
  }
  return come;
}

TEST(SpringAnswers, ComeAtTheirRateAndAsLateAsTheyAre) {
  SpringAnswers answers(0.016, 0.035);
  answers.present(everywhere(25));
  const auto come = run(answers, -0.001, 100, 1100);
  EXPECT_EQ(come.size(), 61u);  // of the 63 that are asked for in a second the last two are on their way
  for (std::size_t n = 0; n < come.size(); ++n) {
    EXPECT_EQ(come[n].sample.sequence, n + 1);
    EXPECT_NEAR(come[n].sample.pose_time_s, 0.1 + 0.016 * static_cast<double>(n), 1e-9);
    EXPECT_NEAR(1e-9 * static_cast<double>(come[n].received_ns) - come[n].sample.pose_time_s, 0.035, 1e-9);
    EXPECT_NEAR(come[n].period_s, 0.016, 1e-12);
    EXPECT_TRUE(come[n].covered && come[n].has_force);
  }
}

TEST(SpringAnswers, ForeseeTheSpringOutOfContact) {
  SpringAnswers answers(0.001, 0);
  answers.present(everywhere(40));
  const ForceSample above = run(answers, -0.002, 0, 1).at(0).sample;
  EXPECT_FALSE(above.contact);
  EXPECT_TRUE(above.foreseen);
  EXPECT_GT(above.position_m.y(), 0);
  EXPECT_NEAR(above.force_n.y(), -40 * above.position_m.y(), 1e-12);
  const ForceSample pressed = run(answers, 0.003, 1, 2).at(0).sample;
  EXPECT_TRUE(pressed.contact);
  EXPECT_FALSE(pressed.foreseen);
  EXPECT_EQ(pressed.position_m, Vector3(0.01, 0.003, 0));
  EXPECT_NEAR(pressed.force_n.y(), -0.12, 1e-12);
  EXPECT_EQ(pressed.tangent_n_m(1, 1), -40);
}

TEST(SpringTissue, ForceAndTangentAreSlopesOfTheEnergy) {
  const SpringTissue tissue{25, 40, 0.03, 0.01, 0.0015};
  constexpr double kStep = 1e-6;
  const auto energy_j = [&](const Vector3& p) { return -tissue.answer(p).force_n.y() * p.y() / 2; };
  for (const double x_m : {0.001, 0.0195, 0.021, 0.03, 0.0385, 0.042}) {
    const Vector3 place_m(x_m, 0.003, 0);
    const ForceSample answer = tissue.answer(place_m);
    for (int i = 0; i < 3; ++i) {
      const Vector3 step_m = kStep * Vector3::Unit(i);
      const double slope_n = (energy_j(place_m + step_m) - energy_j(place_m - step_m)) / (2 * kStep);
      EXPECT_NEAR(answer.force_n[i], -slope_n, 1e-6) << x_m;
      const Vector3 bend =
          (tissue.answer(place_m + step_m).force_n - tissue.answer(place_m - step_m).force_n) / (2 * kStep);
      EXPECT_LE((answer.tangent_n_m.col(i) - bend).norm(), 1e-4) << x_m;
    }
  }
  EXPECT_NEAR(-tissue.answer({0.03, 0.002, 0}).force_n.y() / 0.002, 40, 0.05);
  EXPECT_NEAR(-tissue.answer({0.0, 0.002, 0}).force_n.y() / 0.002, 25, 0.05);
  // without an end it is a spring, exactly
  const ForceSample spring = everywhere(40).answer({0.01, 0.002, 0});
  EXPECT_EQ(spring.force_n, Vector3(0, -0.08, 0));
  EXPECT_EQ(spring.tangent_n_m(1, 1), -40);
  EXPECT_EQ(spring.tangent_n_m(0, 0), 0);
}

TEST(SpringAnswers, NothingNewIsToldUnderAPressedFinger) {
  SpringAnswers answers(0.01, 0.02);
  answers.present(everywhere(25));
  run(answers, -0.001, 0, 100);
  EXPECT_GE(answers.arrived(), 7u);
  EXPECT_TRUE(answers.is_presented(1));
  // WHEN the next is presented while the finger is pressed THEN all goes on as before
  run(answers, 0.003, 100, 150);
  answers.present(everywhere(37));
  for (const ServoAnswer& answer : run(answers, 0.003, 150, 300))
    EXPECT_EQ(answer.sample.tangent_n_m(1, 1), -25);
  EXPECT_EQ(answers.arrived(), 0u);
  EXPECT_FALSE(answers.is_presented(30));
  // WHEN it was lifted for no longer than one pose between two answers THEN it is shown, and what is still on
  // its way of the old one does not count
  answers.add(at(-0.001, 305));
  const auto come = run(answers, 0.003, 306, 350);
  unsigned of_the_new = 0;
  for (const ServoAnswer& answer : come) {
    const bool fresh = answer.sample.tangent_n_m(1, 1) == -37;
    EXPECT_EQ(answers.is_presented(answer.sample.sequence), fresh);
    of_the_new += fresh;
  }
  EXPECT_GT(come.size(), of_the_new);
  EXPECT_EQ(answers.arrived(), of_the_new);
  EXPECT_GE(of_the_new, 2u);
  // the same once more is new too
  answers.present(everywhere(37));
  EXPECT_FALSE(answers.is_presented(come.back().sample.sequence));
}

TEST(SpringAnswers, AfterAPauseOfPosesThereIsNoBurst) {
  SpringAnswers answers(0.01, 0);
  answers.present(everywhere(25));
  run(answers, -0.001, 0, 50);
  EXPECT_EQ(run(answers, -0.001, 1000, 1050).size(), 5u);
}

}  // namespace
}  // namespace teletact::client
