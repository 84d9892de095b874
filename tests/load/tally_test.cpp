#include "bench/load/tally.h"

#include <gtest/gtest.h>

namespace teletact::bench {
namespace {

// The service takes the newest pose: those that it never saw were late, too.
TEST(Unanswered, AnAnswerIsOneToAllPosesBeforeIt) {
  Unanswered unanswered;
  LatencyHistogram latency;
  for (int k = 0; k < 100; ++k) EXPECT_EQ(unanswered.intend(0.01 * k), k + 1u);
  unanswered.answered(50, 1.0, 0, latency);
  EXPECT_EQ(latency.count(), 50u);
  EXPECT_EQ(latency.max_s(), 1.0);
  EXPECT_NEAR(latency.quantile(0.5), 1 - 0.245, 0.01);
  unanswered.answered(50, 2.0, 0, latency);
  EXPECT_EQ(latency.count(), 50u) << "once";
  EXPECT_EQ(unanswered.count(0), 50u);
  EXPECT_EQ(unanswered.count(0.75), 25u);
  unanswered.answered(1000, 1.0, 0.9, latency);
  EXPECT_EQ(latency.count(), 60u) << "those before the warm-up's end are not counted";
  EXPECT_EQ(unanswered.intend(2), 101u);
}

TEST(Tally, OfSeveralProcessesAddsUp) {
  Tally a, b;
  a.intended = 3, a.refused["UNAVAILABLE"] = 1, b.intended = 4, b.refused["UNAVAILABLE"] = 2;
  a.latency.add(0.5), b.latency.add(1.5);
  a.refusing.add(0.1), b.refusing.add(0.2), b.opening.add(0.3);
  b.held_back = 1, b.unanswered = 2, b.answers = 5, b.opened = 6, b.cancelled = 7, b.without_force = 8;
  a.add(nlohmann::json(b).get<Tally>());
  EXPECT_EQ(a.intended, 7u);
  EXPECT_EQ(a.refused.at("UNAVAILABLE"), 3u);
  EXPECT_EQ(a.latency.count(), 2u);
  EXPECT_EQ(a.refusing.count(), 2u);
  EXPECT_EQ(a.opening.count(), 1u);
  EXPECT_EQ(a.held_back + a.unanswered + a.answers + a.opened + a.cancelled + a.without_force, 29u);
}

}  // namespace
}  // namespace teletact::bench
