// Who may have force, and when: every state against everything that can happen to it.
#include "client/servo/states.h"

#include <gtest/gtest.h>

#include <vector>

namespace teletact::client {
namespace {

// All is well, out of contact; nobody asks for anything.
StateInputs fine() {
  StateInputs inputs;
  inputs.link_alive = true;
  inputs.silence_is_zero = false;
  inputs.out_of_contact = true;
  return inputs;
}
StateInputs asked() {
  StateInputs inputs = fine();
  inputs.resume = true;
  return inputs;
}

StateMachine enabled() {
  StateMachine states;
  states.step(asked(), 100);
  EXPECT_EQ(states.state(), ServoState::kEnabled);
  return states;
}
StateMachine paused() {
  StateMachine states = enabled();
  StateInputs silent = fine();
  silent.silence_is_zero = true;
  silent.link_alive = false;
  states.step(silent, 200);
  EXPECT_EQ(states.state(), ServoState::kPaused);
  return states;
}
StateMachine faulty() {
  StateMachine states = enabled();
  StateInputs lost = fine();
  lost.device_ok = false;
  states.step(lost, 200);
  EXPECT_EQ(states.state(), ServoState::kFault);
  return states;
}
std::vector<StateMachine> without_force() {
  return {StateMachine(), paused(), faulty()};
}

TEST(States, ForceNeedsARequestOutOfContactAndAnswers) {
  for (const StateMachine& from : without_force()) {
    StateMachine granted = from;
    EXPECT_TRUE(granted.step(asked(), 300));
    EXPECT_EQ(granted.state(), ServoState::kEnabled);
    EXPECT_EQ(granted.reason(), StateReason::kResumed);
    EXPECT_EQ(granted.since_ns(), 300);
    const auto refused = [&](auto&& spoil) {
      StateMachine states = from;
      StateInputs inputs = asked();
      spoil(inputs);
      states.step(inputs, 300);
      EXPECT_NE(states.state(), ServoState::kEnabled) << name(from.state());
      // A wish that was not granted is not kept: when all is well again nothing happens by itself.
      states.step(fine(), 301);
      EXPECT_NE(states.state(), ServoState::kEnabled) << name(from.state());
    };
    refused([](StateInputs& inputs) { inputs.resume = false; });
    refused([](StateInputs& inputs) { inputs.out_of_contact = false; });
    refused([](StateInputs& inputs) { inputs.link_alive = false; });
    refused([](StateInputs& inputs) { inputs.too_fast = true; });
    refused([](StateInputs& inputs) { inputs.pause = true; });
    refused([](StateInputs& inputs) { inputs.disable = true; });
    refused([](StateInputs& inputs) { inputs.device_ok = false; });
    refused([](StateInputs& inputs) { inputs.finite = false; });
    refused([](StateInputs& inputs) { inputs.frozen = true; });
  }
}

TEST(States, ForceIsTakenForEachReasonAndTheReasonIsSaid) {
  struct Case {
    void (*happens)(StateInputs&);
    ServoState state;
    StateReason reason;
  };
  for (const Case& c : std::vector<Case>{
           {[](StateInputs& in) { in.silence_is_zero = true; }, ServoState::kPaused, StateReason::kSilence},
           {[](StateInputs& in) { in.pause = true; }, ServoState::kPaused, StateReason::kPausedByUser},
           {[](StateInputs& in) { in.disable = true; }, ServoState::kDisabled, StateReason::kDisabledByUser},
           {[](StateInputs& in) { in.device_ok = false; }, ServoState::kFault, StateReason::kDeviceLost},
           {[](StateInputs& in) { in.finite = false; }, ServoState::kFault, StateReason::kNotFinite},
           {[](StateInputs& in) { in.frozen = true; }, ServoState::kFault, StateReason::kFrozen},
           {[](StateInputs& in) { in.too_fast = true; }, ServoState::kFault, StateReason::kTooFast}}) {
    for (const bool in_contact : {false, true}) {
      StateMachine states = enabled();
      StateInputs inputs = fine();
      inputs.out_of_contact = !in_contact;
      EXPECT_FALSE(states.step(inputs, 400)) << "nothing has happened yet";
      c.happens(inputs);
      EXPECT_TRUE(states.step(inputs, 500));
      EXPECT_EQ(states.state(), c.state);
      EXPECT_EQ(states.reason(), c.reason);
      EXPECT_EQ(states.since_ns(), 500);
      EXPECT_FALSE(states.step(inputs, 600)) << "said once";
      EXPECT_STRNE(describe(states.reason()), "?");
    }
  }
}

TEST(States, WhatFadesOnlyIsNoPause) {
  // GIVEN silence that has begun to fade the force, but not to nothing
  StateMachine states = enabled();
  StateInputs fading = fine();
  fading.link_alive = false;
  EXPECT_FALSE(states.step(fading, 500));
  EXPECT_EQ(states.state(), ServoState::kEnabled);
}

TEST(States, TheWorstIsSaidFirst) {
  StateMachine states = enabled();
  StateInputs all = fine();
  all.device_ok = all.finite = false;
  all.too_fast = all.silence_is_zero = all.pause = all.disable = true;
  states.step(all, 500);
  EXPECT_EQ(states.reason(), StateReason::kDeviceLost);
}

}  // namespace
}  // namespace teletact::client
