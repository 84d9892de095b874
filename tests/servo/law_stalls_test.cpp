// A contact law through the whole loop while answers stop, and say nothing.
#include "client/render/law_renderer.h"
#include "tests/render/tissue_law.h"
#include "tests/servo/servo_test.h"

namespace teletact::client {
namespace {

class LawStalls : public test::ServoTest {
 protected:
  LawStalls() {
    version = 1;
    servo = std::make_unique<ServoLoop>(device, law_renderer, clock, options);
    servo->laws().put(test::law_of(tissue, version, 0, 0.06));
  }
  // Pressed, by the law.
  void press() {
    enable();
    run(0.6);
    put_finger(0.004);
    run(0.3);
    ASSERT_TRUE(last.by_law);
    ASSERT_GT(last.force_n.norm(), 0.3);
    pressed_n = last.force_n.norm();
    largest_step_n = 0;
  }
  LawRenderer law_renderer;
  double pressed_n = 0;
};

// Longer than a force by answers would last, and than a model may be old.
TEST_F(LawStalls, InAStallOfAThirdOfASecondTheLawIsFeltAsItIs) {
  press();
  for (int stall = 0; stall < 3; ++stall) {
    silent = true;
    run(0.33);
    silent = false;
    run(0.05);
    EXPECT_EQ(last.state, ServoState::kEnabled);
    EXPECT_FALSE(last.degraded);
  }
  EXPECT_EQ(largest_step_n, 0);
}

// 7 % in 10 ms, down and up again.
TEST_F(LawStalls, ALongerStallFadesTheLawAndItComesBackWithoutAStep) {
  press();
  silent = true;
  run(0.42);
  EXPECT_LT(last.force_n.norm(), 0.6 * pressed_n);
  EXPECT_GT(last.force_n.norm(), 0);
  silent = false;
  run(0.1);
  EXPECT_NEAR(last.force_n.norm(), pressed_n, 1e-9);
  EXPECT_LT(largest_step_n, 0.007 * pressed_n);
  EXPECT_GE(last.balance_j, -1e-12);
}

TEST_F(LawStalls, ALawThatEndsInAStallFadesFromThereOn) {
  press();
  silent = true;
  run(0.2);
  EXPECT_EQ(largest_step_n, 0);
  NearLaw elsewhere = test::law_of(tissue, version, 0.04, 0.06);
  servo->laws().put(elsewhere);
  run(0.1);
  EXPECT_FALSE(last.by_law);
  EXPECT_GT(last.force_n.norm(), 0);
  run(0.07);
  EXPECT_EQ(last.force_n.norm(), 0);
  EXPECT_EQ(last.state, ServoState::kPaused);
  EXPECT_LT(largest_step_n, 0.0075 * pressed_n);
}

// Answers come, and none says any more that there is something to feel.
TEST_F(LawStalls, ALawThatNoAnswerConfirmsGetsOld) {
  press();
  has_force = false;
  run(0.2);
  EXPECT_FALSE(last.degraded);
  run(0.2);
  EXPECT_TRUE(last.degraded);
  run(0.2);
  EXPECT_EQ(last.force_n.norm(), 0);
}

}  // namespace
}  // namespace teletact::client
