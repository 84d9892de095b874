// Who steers a scene: one stream at a time, for as long as it is heard.
#include "service/scene/finger.h"

#include <gtest/gtest.h>

namespace teletact::service {
namespace {

class Lease : public testing::Test {
 protected:
  using Stream = FingerBoard::Stream;
  static FingerBoard::Clock::time_point at(double s) {
    return FingerBoard::Clock::time_point(std::chrono::hours(1)) +
           std::chrono::duration_cast<FingerBoard::Clock::duration>(std::chrono::duration<double>(s));
  }
  void touch(Stream stream, double x_m, double s) {
    board.arrive(stream, {x_m, 0.001, 0}, {0.1, 0, 0}, at(s));
  }
  std::string steered_by(double s) { return board.at(at(s)).session_id; }
  bool steers(Stream stream, double s) { return board.steering(stream, at(s)).steers; }
  FingerBoard board;
};

TEST_F(Lease, TellsTheLeastToleranceThatAnybodyHereAsksFor) {
  EXPECT_EQ(board.tolerance(), 0.03);
  const Stream anna = board.join("anna", at(0), 0.1);
  EXPECT_EQ(board.tolerance(), 0.1);
  const Stream berta = board.join("berta", at(0), 0.02);
  EXPECT_EQ(board.tolerance(), 0.02);
  board.leave(berta, at(1)), board.leave(anna, at(1));
  EXPECT_EQ(board.tolerance(), 0.03);
}

TEST_F(Lease, FirstStreamSteersAndTheOthersPosesAreNotShown) {
  // GIVEN two streams on a scene
  const Stream anna = board.join("anna", at(0)), berta = board.join("berta", at(0.1));
  // WHEN both bring poses
  touch(anna, 0.01, 0.2);
  touch(berta, 0.09, 0.3);
  // THEN the board shows the first one's, and each is told
  const Finger finger = board.at(at(0.3));
  EXPECT_TRUE(finger.present);
  EXPECT_EQ(finger.position_m[0], 0.01);
  EXPECT_EQ(finger.velocity_m_s[0], 0.1);
  EXPECT_EQ(finger.session_id, "anna");
  EXPECT_GT(finger.stamp_ns, 0);
  EXPECT_TRUE(steers(anna, 0.3));
  EXPECT_FALSE(steers(berta, 0.3));
  EXPECT_EQ(board.steering(berta, at(0.3)).by, "anna");
}

TEST_F(Lease, WhoMayNotSteerNeverDoes) {
  const auto observe = [&](const char* name, double s) { return board.join(name, at(s), 0.03, false); };
  const Stream watching = observe("watching", 0);
  touch(watching, 0.01, 0.1);
  EXPECT_FALSE(board.at(at(0.1)).present) << "alone in the scene";
  const Stream anna = board.join("anna", at(0.2));
  EXPECT_TRUE(steers(anna, 0.2));
  board.hand_over(anna, "watching", at(0.3));
  EXPECT_EQ(board.now().session_id, "anna") << "not even by hand";
  EXPECT_TRUE(steers(anna, 0.3));
  touch(watching, 0.02, 5);
  EXPECT_EQ(steered_by(5), "") << "nor when the one who may falls silent";
  board.leave(anna, at(5));
  EXPECT_FALSE(steers(watching, 5));
}

TEST_F(Lease, EveryChangeIsCountedAndNothingElse) {
  const Stream anna = board.join("anna", at(0)), berta = board.join("berta", at(0));
  const auto generation = [&] { return board.at(at(0.1)).generation; };
  const auto first = generation();
  EXPECT_EQ(generation(), first);
  touch(berta, 0.09, 0.1);
  EXPECT_EQ(generation(), first);
  touch(anna, 0.01, 0.1);
  EXPECT_GT(generation(), first);
}

TEST_F(Lease, TheSliceThatItsFingerLacksIsToldUntilAnotherSteers) {
  const Stream anna = board.join("anna", at(0)), berta = board.join("berta", at(0));
  const auto generation = [&] { return board.at(at(0.1)).generation; };
  const auto first = generation();
  board.wish(berta, SliceWish{0.01, 1});
  EXPECT_FALSE(board.at(at(0.1)).wish) << "who does not steer wishes nothing";
  board.wish(anna, std::nullopt);
  EXPECT_EQ(generation(), first);
  board.wish(anna, SliceWish{0.01, 1});
  EXPECT_EQ(board.at(at(0.1)).wish, (SliceWish{0.01, 1}));
  EXPECT_EQ(generation(), first + 1) << "watchers are told";
  board.wish(anna, SliceWish{0.01, 1});
  EXPECT_EQ(generation(), first + 1) << "the same again is no news";
  board.wish(anna, std::nullopt);
  EXPECT_FALSE(board.at(at(0.1)).wish);
  EXPECT_EQ(generation(), first + 2);
  board.wish(anna, SliceWish{0.01, 1});
  board.hand_over(anna, "berta", at(0.1));
  EXPECT_FALSE(board.at(at(0.1)).wish) << "another hand's";
}

TEST_F(Lease, GoesToWhoWaitsLongestWhenItsStreamEnds) {
  const Stream anna = board.join("anna", at(0));
  board.join("berta", at(0.1)), board.join("carla", at(0.2));
  touch(anna, 0.01, 0.3);
  board.leave(anna, at(0.4));
  EXPECT_EQ(steered_by(0.4), "berta");
  // The arm stays where it was until the new hand has said where it is.
  EXPECT_EQ(board.at(at(0.4)).position_m[0], 0.01);
  EXPECT_EQ(board.at(at(0.4)).velocity_m_s[0], 0);
  board.leave(anna, at(0.5));
  EXPECT_EQ(steered_by(0.5), "berta");
}

TEST_F(Lease, LapsesAfterTwoSecondsWithoutAPose) {
  // GIVEN one that steers and two that wait, all of them touching
  const Stream anna = board.join("anna", at(0)), berta = board.join("berta", at(0)),
               carla = board.join("carla", at(0));
  touch(anna, 0.01, 1);
  // WHEN it falls silent
  for (const double s : {1.5, 2.5}) touch(berta, 0.02, s), touch(carla, 0.03, s);
  EXPECT_EQ(steered_by(2.9), "anna");
  // THEN the lease goes to the one that waits longest, and its poses are shown
  EXPECT_EQ(steered_by(3.1), "berta");
  touch(berta, 0.021, 3.2);
  EXPECT_EQ(board.at(at(3.2)).position_m[0], 0.021);
  // AND when the first is heard again it waits behind the others
  touch(anna, 0.01, 3.3), touch(carla, 0.03, 3.3);
  EXPECT_EQ(steered_by(3.3), "berta");
  board.leave(berta, at(3.4));
  EXPECT_EQ(steered_by(3.4), "carla");
}

TEST_F(Lease, PassesOverThoseWhoAreSilentThemselves) {
  const Stream anna = board.join("anna", at(0));
  board.join("berta", at(0));  // never heard again
  const Stream carla = board.join("carla", at(0));
  touch(anna, 0.01, 1), touch(carla, 0.03, 2.5);
  EXPECT_EQ(steered_by(3.1), "carla");
}

TEST_F(Lease, OfASceneWhereAllAreSilentIsNobodysUntilOneIsHeard) {
  const Stream anna = board.join("anna", at(0)), berta = board.join("berta", at(0));
  touch(anna, 0.01, 0.1);
  EXPECT_FALSE(board.at(at(5)).present);
  EXPECT_EQ(steered_by(5), "");
  EXPECT_EQ(board.at(at(5)).position_m[0], 0.01);  // where it was last
  EXPECT_FALSE(steers(anna, 5));
  touch(berta, 0.02, 6);
  EXPECT_TRUE(steers(berta, 6));
  EXPECT_EQ(board.at(at(6)).position_m[0], 0.02);
}

TEST_F(Lease, SilentStreamTakesItAgainIfAlone) {
  const Stream anna = board.join("anna", at(0));
  touch(anna, 0.01, 9);
  EXPECT_TRUE(steers(anna, 9));
}

TEST_F(Lease, LapsesWhetherOrNotAnybodyLookedMeanwhile) {
  const Stream anna = board.join("anna", at(0)), berta = board.join("berta", at(0));
  touch(berta, 0.02, 2.5);  // by now it is berta's
  touch(anna, 0.01, 2.6);
  EXPECT_EQ(steered_by(2.6), "berta");
}

TEST_F(Lease, IsHandedOverByName) {
  // GIVEN three streams
  const Stream anna = board.join("anna", at(0)), berta = board.join("berta", at(0)),
               carla = board.join("carla", at(0));
  // WHEN the one that steers names the third
  board.hand_over(anna, "carla", at(1));
  // THEN that one steers, and the first waits behind the second
  EXPECT_TRUE(steers(carla, 1));
  touch(anna, 0.01, 1.5), touch(berta, 0.02, 1.5);
  board.leave(carla, at(1.6));
  EXPECT_TRUE(steers(berta, 1.6));
}

TEST_F(Lease, HandedToAStreamThatRestsIsKeptForTwoSeconds) {
  const Stream anna = board.join("anna", at(0));
  board.join("berta", at(0));
  touch(anna, 0.01, 5);
  board.hand_over(anna, "berta", at(5));
  touch(anna, 0.01, 6.9);
  EXPECT_EQ(steered_by(6.9), "berta");
  EXPECT_EQ(steered_by(7.1), "anna");
}

TEST_F(Lease, IsNotHandedOverByWhoDoesNotSteerNorToWhoIsNotThere) {
  const Stream anna = board.join("anna", at(0)), berta = board.join("berta", at(0));
  board.join("", at(0));
  board.hand_over(berta, "berta", at(0.1));
  board.hand_over(anna, "nobody", at(0.1));
  board.hand_over(anna, "anna", at(0.1));  // nobody else has that name
  board.hand_over(anna, "", at(0.1));      // a stream without a name is nobody's to name
  EXPECT_TRUE(steers(anna, 0.1));
}

TEST_F(Lease, OfANameThatSeveralHaveGoesToWhoWaitsLongest) {
  const Stream anna = board.join("anna", at(0)), first = board.join("twin", at(0)),
               second = board.join("twin", at(0));
  board.hand_over(anna, "twin", at(0.1));
  EXPECT_TRUE(steers(first, 0.1));
  board.hand_over(first, "twin", at(0.2));
  EXPECT_TRUE(steers(second, 0.2));
  EXPECT_FALSE(steers(first, 0.2));
}

TEST_F(Lease, EndsWithTheLastStream) {
  const Stream anna = board.join("anna", at(0));
  touch(anna, 0.01, 0.1);
  board.leave(anna, at(0.2));
  const Finger finger = board.at(at(0.2));
  EXPECT_FALSE(finger.present);
  EXPECT_EQ(finger.session_id, "");
  EXPECT_EQ(finger.position_m[0], 0.01);
}

}  // namespace
}  // namespace teletact::service
