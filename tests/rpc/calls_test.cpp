// Places of calls, without gRPC.
#include "service/rpc/calls.h"

#include <gtest/gtest.h>

#include "service/scene/errors.h"

namespace teletact::service {
namespace {

class Idle : public Served {
  void look(std::chrono::steady_clock::time_point) override {}
};

// GIVEN a client that holds as many places as it may, WHEN one of its calls is about to be told its end, THEN
// its next call has a place, though gRPC is not done with the other one.
TEST(Calls, APlaceIsFreeOnceItsCallIsToldTheEnd) {
  Limits limits;
  limits.max_estimates = 4;
  Calls calls(limits);
  calls.open();
  const auto idle = std::make_shared<Idle>();
  const auto enter = [&] { return calls.enter(CallKind::kEstimate, idle, "anna"); };
  const auto first = enter(), second = enter();
  EXPECT_THROW(enter(), Error);
  first->give_place_back();
  const auto third = enter();
  EXPECT_THROW(enter(), Error);
  EXPECT_EQ(calls.count(CallKind::kEstimate), 3U) << "all are looked after";
}

}  // namespace
}  // namespace teletact::service
