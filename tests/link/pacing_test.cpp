// The poses in flight, over links of which every number is known: no network, no clock.
#include "client/link/pacing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <random>
#include <vector>

namespace teletact::client {
namespace {

// A delay, then a bottleneck that takes one answer after the other.
struct Link {
  double round_trip_s = 0, answer_s = 0, jitter_s = 0;
};

struct Flown {
  std::vector<double> ages_s;  // of the answers, in their order
  std::vector<double> received_s;
  unsigned max_in_flight = 0;
  double answers_per_s(double from_s, double to_s) const {
    return static_cast<double>(std::count_if(received_s.begin(), received_s.end(),
                                             [&](double s) { return s >= from_s && s < to_s; })) /
           (to_s - from_s);
  }
  double age_s(double share, double from_s) const {
    std::vector<double> ages;
    for (std::size_t k = 0; k < ages_s.size(); ++k)
      if (received_s[k] >= from_s) ages.push_back(ages_s[k]);
    std::sort(ages.begin(), ages.end());
    return ages.empty() ? 1e9 : ages[static_cast<std::size_t>(share * static_cast<double>(ages.size() - 1))];
  }
};

// Sends as the link's writer does, every 0.25 ms at most. `link` is asked at each pose: it may change. Until
// `seldom_until_s` as where a contact law is felt: 20 poses a second at most.
template <class LinkAt>
Flown run(Pacing pacing, double seconds, LinkAt&& link_at, double seldom_until_s = 0) {
  struct Flight {
    std::uint64_t sequence;
    double sent_s, arrives_s;
  };
  constexpr double kStepS = 0.00025, kSeldomS = 0.05;
  Flown flown;
  std::deque<Flight> flights;
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> share(0, 1);
  double next_s = 0, free_s = 0, last_s = 0;
  std::uint64_t sequence = 0;
  for (double now_s = 0; now_s < seconds; now_s += kStepS) {
    for (; !flights.empty() && flights.front().arrives_s <= now_s; flights.pop_front()) {
      const Flight& flight = flights.front();
      pacing.answered(flight.sequence, flight.arrives_s - flight.sent_s,
                      static_cast<std::int64_t>(flight.arrives_s * 1e9));
      flown.ages_s.push_back(flight.arrives_s - flight.sent_s);
      flown.received_s.push_back(flight.arrives_s);
    }
    if (now_s < next_s || flights.size() >= pacing.in_flight()) continue;
    const Link link = link_at(now_s);
    free_s =
        std::max(free_s, now_s + link.round_trip_s + link.jitter_s * (2 * share(random) - 1)) + link.answer_s;
    last_s = std::max(last_s, free_s);  // in order
    flights.push_back({++sequence, now_s, last_s});
    pacing.sent(sequence);
    flown.max_in_flight = std::max(flown.max_in_flight, static_cast<unsigned>(flights.size()));
    const double interval_s = std::max(pacing.interval_s(), now_s < seldom_until_s ? kSeldomS : 0);
    next_s = std::max(next_s + interval_s, now_s + interval_s / 2);
  }
  return flown;
}

constexpr double kPeriodS = 0.002;

TEST(Pacing, FillsAConstantRoundTripWithTheNegotiatedRate) {
  for (const double round_trip_s : {0.0003, 0.05, 0.1, 0.2, 0.3}) {
    const Flown touched = run(Pacing(kPeriodS, 256), 10, [&](double) { return Link{round_trip_s}; });
    EXPECT_GE(touched.answers_per_s(5, 10), 0.95 / kPeriodS) << round_trip_s;
    EXPECT_LE(touched.max_in_flight, 3 + round_trip_s / kPeriodS) << round_trip_s;
    EXPECT_LE(touched.age_s(1, 0), round_trip_s + kPeriodS) << round_trip_s;
    // Soon, too: twice as many with each round trip.
    EXPECT_GE(touched.answers_per_s(10 * round_trip_s, 5), 0.9 / kPeriodS) << round_trip_s;
  }
}

TEST(Pacing, ALoneLoopbackIsLeftAsItWas) {
  const Flown touched = run(Pacing(kPeriodS, 256), 3, [](double) { return Link{0.0003}; });
  EXPECT_LE(touched.max_in_flight, Pacing::kFewest);
}

TEST(Pacing, NeverMoreThanTheCredit) {
  EXPECT_EQ(run(Pacing(kPeriodS, 8), 5, [](double) { return Link{0.1}; }).max_in_flight, 8u);
  EXPECT_EQ(run(Pacing(kPeriodS, 1), 5, [](double) { return Link{0.1}; }).max_in_flight, 1u);
  EXPECT_EQ(run(Pacing(0.001, 1'000'000), 30, [](double) { return Link{0.4}; }).max_in_flight,
            Pacing::kMax);
}

TEST(Pacing, ANarrowLinkIsFilledAndBuildsNoQueue) {
  for (const double answer_s : {0.0036, 0.012, 0.1}) {  // 277, 83 and 10 answers a second
    const double unloaded_s = 0.1 + answer_s;
    const Flown touched = run(Pacing(kPeriodS, 256), 20, [&](double) { return Link{0.1, answer_s}; });
    EXPECT_GE(touched.answers_per_s(5, 20), 0.8 / answer_s) << answer_s;
    EXPECT_LE(touched.age_s(0.5, 5), unloaded_s + std::max(2 * kPeriodS, answer_s)) << answer_s;
    EXPECT_LE(touched.age_s(0.95, 5), unloaded_s + 2 * (kPeriodS + answer_s)) << answer_s;
    EXPECT_LE(touched.age_s(1, 0), unloaded_s + 0.6) << "at first, before the queue was seen: " << answer_s;
  }
}

TEST(Pacing, AnotherRoundTripIsFilledToo) {
  // GIVEN a link that takes a longer way THEN that is no queue, and the rate is back soon.
  const Flown touched =
      run(Pacing(kPeriodS, 256), 16, [](double now_s) { return Link{now_s < 5 ? 0.05 : 0.15}; });
  EXPECT_GE(touched.answers_per_s(3, 5), 0.95 / kPeriodS);
  EXPECT_GE(touched.answers_per_s(10, 16), 0.9 / kPeriodS);
}

TEST(Pacing, ALinkThatGetsNarrowIsEmptiedAndOneThatWidensFilled) {
  const Flown touched = run(Pacing(kPeriodS, 256), 24, [](double now_s) {
    return Link{0.1, now_s < 5 || now_s > 12 ? 0.0 : 0.02};
  });
  EXPECT_GE(touched.answers_per_s(8, 12), 0.7 / 0.02);
  double oldest_s = 0;
  for (std::size_t k = 0; k < touched.ages_s.size(); ++k)
    if (touched.received_s[k] > 10.5 && touched.received_s[k] < 12)
      oldest_s = std::max(oldest_s, touched.ages_s[k]);
  EXPECT_LE(oldest_s, 0.12 + 0.08);
  EXPECT_GE(touched.answers_per_s(20, 24), 0.9 / kPeriodS);
}

// Few poses show no queue, whatever the link: it must not be taken for a wide one.
TEST(Pacing, PosesThatAreFewSayNothingOfTheRoomForMore) {
  const auto narrow = [](double) { return Link{0.1, 0.02}; };
  const Flown touched = run(Pacing(kPeriodS, 256), 15, narrow, 10);
  EXPECT_NEAR(touched.answers_per_s(5, 10), 20, 1);
  EXPECT_LE(touched.age_s(1, 0), 1.2 * run(Pacing(kPeriodS, 256), 5, narrow).age_s(1, 0))
      << "as a new stream";
  EXPECT_GE(touched.answers_per_s(12, 15), 0.8 / 0.02);
}

TEST(Pacing, AMachineThatWasBusyIsFilledAgainSoon) {
  // GIVEN one round trip that took 50 ms more, while the link was being filled
  const Flown touched = run(Pacing(kPeriodS, 256), 12,
                            [](double now_s) { return Link{now_s > 0.5 && now_s < 0.8 ? 0.35 : 0.3}; });
  EXPECT_GE(touched.answers_per_s(5, 12), 0.9 / kPeriodS);
}

TEST(Pacing, JitterIsToldFromAQueueInPart) {
  // The fewest in flight would bring 20 answers a second at most.
  const auto jitters = [](double) { return Link{0.1, 0, 0.03}; };
  EXPECT_GE(run(Pacing(0.01, 256), 20, jitters).answers_per_s(5, 20), 25);
  EXPECT_GE(run(Pacing(kPeriodS, 256), 20, jitters).answers_per_s(5, 20), 25);
}

TEST(Pacing, PosesComeAsSeldomAsABusyServiceAnswers) {
  Pacing pacing(0.002, 8);
  pacing.keep(0.05);
  EXPECT_EQ(pacing.interval_s(), 0.05);
  pacing.keep(0.002);
  EXPECT_EQ(pacing.interval_s(), 0.002);
}

}  // namespace
}  // namespace teletact::client
