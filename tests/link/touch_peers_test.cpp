// What a peer says, withholds or refuses on a touch stream, and what comes of it.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <thread>
#include <tuple>

#include "client/link/servo_messages.h"
#include "tests/link/operator.h"

namespace teletact::client {
namespace {

using test::answers_at_least;
using test::FakeAccount;
using test::FakePalpation;
using test::Operator;
using test::within;

// Every opened stream is ended for its first pose: ten times a second is not how to ask again.
TEST(TouchPeers, RefusedStreamIsTriedEverMoreSeldom) {
  FakePalpation service(test::socket_address("refused"));
  service.refuses = true;
  service.serve();
  const auto begin = std::chrono::steady_clock::now();
  Operator finger(test::socket_address("refused"));
  ASSERT_TRUE(service.wait_until([](const FakeAccount& account) { return account.streams == 4; }));
  EXPECT_GE(test::seconds_since(begin), 0.7) << "after 0.1, 0.2 and 0.4 s";
  EXPECT_EQ(finger.link->failure(), "");
  EXPECT_TRUE(within(5, [&] {
    return finger.link->trouble().find("INVALID_ARGUMENT: position_m") != std::string::npos;
  })) << finger.link->trouble();
  service.refuses = false;
  EXPECT_TRUE(service.wait_until(answers_at_least(1), 20));
}

TEST(TouchPeers, AServiceThatTakesNothingIsGivenUp) {
  FakePalpation service(test::socket_address("deaf"));
  service.deaf = true;
  service.serve();
  // GIVEN a first message that no buffer between takes as a whole THEN its write ends all the same
  Operator finger(test::socket_address("deaf"), [](TouchLinkOptions& options) {
    options.open_wait_s = 0.3;
    options.open.set_session_id(std::string(std::size_t{2} << 20, 's'));
  });
  EXPECT_TRUE(within(20, [&] {
    return finger.link->trouble().find("the service says nothing") != std::string::npos;
  })) << finger.link->trouble();
  finger.link->stop();
}

TEST(TouchPeers, OpeningWithoutANumberNamesTheField) {
  for (const double period_s : {std::nan(""), -1.0, 1e9}) {
    FakePalpation service(test::socket_address("opened"));
    service.opened_period_s = period_s;
    service.serve();
    Operator finger(test::socket_address("opened"));
    EXPECT_TRUE(within(20, [&] { return !finger.link->failure().empty(); })) << period_s;
    EXPECT_NE(finger.link->failure().find("period_s"), std::string::npos) << finger.link->failure();
    EXPECT_EQ(finger.link->stats().answers, 0u);
  }
  TouchAnswers told;
  v1::TouchOpened opened;
  opened.set_period_s(0.002);
  EXPECT_NE(told.take_opened(opened, 1).find("credit"), std::string::npos);
  opened.set_credit(257);
  EXPECT_NE(told.take_opened(opened, 1).find("credit"), std::string::npos);
  opened.set_credit(2);
  opened.mutable_layer()->set_depth_m(INFINITY);
  EXPECT_NE(told.take_opened(opened, 1).find("layer.depth_m"), std::string::npos);
  opened.mutable_layer()->set_depth_m(0);
  for (const double component : {0.6, 0.6, 0.6}) opened.mutable_layer()->add_normal(component);
  EXPECT_NE(told.take_opened(opened, 1).find("layer.normal 0.6, 0.6, 0.6"), std::string::npos)
      << told.take_opened(opened, 1);
  opened.mutable_layer()->clear_normal();
  opened.mutable_covered()->set_end_x_m(NAN);
  EXPECT_NE(told.take_opened(opened, 1).find("covered"), std::string::npos);
  opened.mutable_covered()->set_end_x_m(0.1);
  opened.mutable_covered()->set_end_z_m(INFINITY);
  EXPECT_NE(told.take_opened(opened, 1).find("covered"), std::string::npos);
  opened.mutable_covered()->clear_end_z_m();
  EXPECT_EQ(told.take_opened(opened, 1), "");
}

TEST(TouchPeers, AServiceThatRefusesALargeCreditIsAskedForLess) {
  FakePalpation service(test::socket_address("older"));
  service.refuses_credit_above = 8;
  service.serve();
  Operator finger(test::socket_address("older"),
                  [](TouchLinkOptions& options) { options.open.set_credit(Pacing::kMax); });
  EXPECT_TRUE(service.wait_until(answers_at_least(10)));
  EXPECT_EQ(finger.link->failure(), "");
}

TEST(TouchPeers, StampsThatNoClockHasAreNotReckonedWith) {
  TouchAnswers told;
  v1::TouchOpened opened;
  opened.set_period_s(0.002);
  opened.set_credit(2);
  opened.set_instance(5);
  ASSERT_EQ(told.take_opened(opened, 1), "");
  v1::TouchAnswer answer;
  answer.set_status(v1::TOUCH_STATUS_NOT_COVERED);
  for (const double m : {0.02, 0.0, 0.0}) answer.add_position_m(m);
  answer.mutable_answer_stamp()->set_instance(5);
  constexpr auto kMax = std::numeric_limits<std::int64_t>::max();
  for (const auto& [left_ns, queued_ns, compute_ns] :
       {std::tuple(kMax, std::int64_t{1}, std::int64_t{1}), std::tuple(std::int64_t{1000}, kMax, kMax),
        std::tuple(-kMax, kMax, std::int64_t{1}),
        std::tuple(std::int64_t{1000}, std::int64_t{-5}, std::int64_t{1})}) {
    answer.mutable_answer_stamp()->set_monotonic_ns(left_ns);
    answer.set_queued_ns(queued_ns);
    answer.set_compute_ns(compute_ns);
    const auto converted = told.take_answer(answer, true, 1'000'000, 2'000'000);
    ASSERT_TRUE(converted.has_value());
    EXPECT_EQ(converted->round_trip_s, 0);
    EXPECT_EQ(told.stats.clock_offset_s, 0);
  }
  answer.mutable_covered()->set_end_x_m(NAN);
  EXPECT_FALSE(told.take_answer(answer, true, 1'000'000, 2'000'000).has_value());
  EXPECT_EQ(told.stats.dropped, 1u);
}

v1::TouchOpened usual_opening() {
  v1::TouchOpened opened;
  opened.set_period_s(0.002);
  opened.set_credit(2);
  return opened;
}
v1::TouchAnswer out_of_contact() {
  v1::TouchAnswer answer;
  answer.set_status(v1::TOUCH_STATUS_OK);
  for (const double m : {0.02, 0.0, 0.0}) answer.add_position_m(m), answer.add_force_n(0);
  return answer;
}

TEST(TouchPeers, AnswersOfAnotherWayAreCountedApart) {
  TouchAnswers told;
  ASSERT_EQ(told.take_opened(usual_opening(), 1), "");
  v1::TouchAnswer answer = out_of_contact();
  told.take_answer(answer, true, 1, 2);  // no contact
  EXPECT_TRUE(told.stats.solved_by.empty());
  answer.mutable_solve()->set_reason("closed form");
  told.take_answer(answer, true, 1, 2);
  answer.set_path(v1::SOLVE_PATH_SHARES);
  told.take_answer(answer, true, 1, 2);
  const std::map<v1::SolvePath, std::uint64_t> expected{{v1::SOLVE_PATH_UNSPECIFIED, 1},
                                                        {v1::SOLVE_PATH_SHARES, 1}};
  EXPECT_EQ(told.stats.solved_by, expected);
}

TEST(TouchPeers, WhatEachTermMakesOfTheIntervalIsSummedUp) {
  TouchAnswers told;
  ASSERT_EQ(told.take_opened(usual_opening(), 1), "");
  v1::TouchAnswer answer = out_of_contact();
  const auto add = [&](int term, v1::ForceError::Kind kind, double relative) {
    v1::ForceError& error = *answer.mutable_budget()->add_terms();
    error.set_term(static_cast<v1::ForceError::Term>(term)), error.set_kind(kind);
    error.set_relative(relative);
  };
  // GIVEN terms whose squares make 0.5 and a bound
  add(v1::ForceError::TERM_MODULUS, v1::ForceError::KIND_DEVIATION, 0.4);
  add(v1::ForceError::TERM_CONTEXT, v1::ForceError::KIND_ESTIMATE, 0.3);
  add(v1::ForceError::TERM_MESH, v1::ForceError::KIND_BOUND, 0.02);
  // AND what no service sends
  for (const double wrong : {-1.0, 1e300, std::nan("")})
    add(v1::ForceError::TERM_MODULUS, v1::ForceError::KIND_DEVIATION, wrong);
  for (const int term : {0, 99}) add(term, v1::ForceError::KIND_BOUND, 1);
  // WHEN two answers bring them THEN each counts by what the interval would be narrower without it
  told.take_answer(answer, true, 1, 2);
  told.take_answer(answer, true, 1, 2);
  ASSERT_EQ(told.stats.made_by.size(), 3u);
  EXPECT_NEAR(told.stats.made_by[v1::ForceError::TERM_MODULUS], 2 * 1.96 * (0.5 - 0.3), 1e-12);
  EXPECT_NEAR(told.stats.made_by[v1::ForceError::TERM_CONTEXT], 2 * 1.96 * (0.5 - 0.4), 1e-12);
  EXPECT_NEAR(told.stats.made_by[v1::ForceError::TERM_MESH], 2 * 0.02, 1e-12);
  EXPECT_EQ(told.stats.force_budget.count(), 2u);
  const auto largest = largest_term(told.stats.made_by);
  ASSERT_TRUE(largest);
  EXPECT_STREQ(largest->what, "the modulus");
  EXPECT_EQ(largest->by, told.stats.made_by[v1::ForceError::TERM_MODULUS]);
  EXPECT_FALSE(largest_term({}));
  // AND one without a width counts for neither
  answer.mutable_budget()->set_half_width(std::nan(""));
  told.take_answer(answer, true, 1, 2);
  EXPECT_NEAR(told.stats.made_by[v1::ForceError::TERM_MESH], 2 * 0.02, 1e-12);
  EXPECT_EQ(told.stats.force_budget.count(), 2u);
}

TEST(TouchPeers, WhatIsBeingPreparedHasNoForceAndIsNoFailure) {
  FakePalpation service(test::socket_address("prepares"));
  service.prepares = true;
  service.serve();
  Operator finger(test::socket_address("prepares"));
  ASSERT_TRUE(service.wait_until(answers_at_least(3)));
  ServoAnswer answer;
  ASSERT_TRUE(within(5, [&] { return finger.answers.take(answer); }));
  EXPECT_FALSE(answer.has_force);
  EXPECT_TRUE(answer.covered);
  EXPECT_GE(finger.link->stats().preparing, 1u);
  EXPECT_EQ(finger.link->stats().failed, 0u);
  service.prepares = false;
  EXPECT_TRUE(within(5, [&] { return finger.answers.take(answer) && answer.has_force; }));
}

TEST(TouchPeers, TheLeaseIsHandedOverByName) {
  FakePalpation service(test::socket_address("lease"));
  service.steers = true;
  service.serve();
  Operator finger(test::socket_address("lease"));
  ASSERT_TRUE(service.wait_until(answers_at_least(1)));
  finger.link->hand_over("berta");
  EXPECT_TRUE(
      service.wait_until([](const FakeAccount& account) { return account.handed_over_to == "berta"; }));
  const auto before = service.account().answers;
  EXPECT_TRUE(service.wait_until(answers_at_least(before + 3)));
  EXPECT_EQ(service.account().disorder, 0u);
}

}  // namespace
}  // namespace teletact::client
