// The arm goes along z: slices are taken, published, and corrected by their neighbours.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <thread>

#include "client/acquire/session.h"
#include "client/link/channel.h"
#include "tests/support/fake_service.h"

namespace teletact::client {
namespace {

// Frames whose first sample says which slice they are of.
class NumberedSlices final : public FrameSource {
 public:
  NumberedSlices(std::size_t slices, std::size_t passes) : left_(slices, passes) {}
  std::size_t window_count() const override { return left_.size(); }
  double window_width_m() const override { return 0.005; }
  double compression_m() const override { return 0.0008; }
  std::size_t frames_left(std::size_t slice) const override {
    asked_since = true;
    return left_.at(slice);
  }
  FramePair take(std::size_t slice) override {
    --left_.at(slice);
    asked_since = false;
    ++taken;
    FramePair pair;
    pair.acquisition.add_maps("valid");
    pair.acquisition.mutable_probe_force()->set_force_n(1);
    pair.pre.assign(64, static_cast<char>(slice));
    pair.post = pair.pre;
    return pair;
  }
  std::atomic<int> taken{0};
  mutable std::atomic<bool> asked_since{false};  // what is left, since the last one was taken

 private:
  std::vector<std::size_t> left_;
};

// Whether it comes true while an observer holds the uploader.
bool comes(const std::function<bool()>& truth) {
  for (int k = 0; k < 10000 && !truth(); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return truth();
}

AcquireOptions options_of(std::size_t slices) {
  AcquireOptions options;
  options.scene_id = "s";
  options.arm = {.speed_m_s = 10, .acceleration_m_s2 = 1000, .settle_s = 0, .frame_rate_hz = 1000};
  options.planner.all = true;
  options.planner.refresh_after_s = HUGE_VAL;
  options.start_x_m = 0;
  options.retry_for_s = 5;
  options.slices = SliceOptions{{0.02, 0.02, 0.48, {slices, -0.01, 0.005}}, 0.012};
  return options;
}

// The first of each place: those that came after correct them.
std::vector<v1::ModulusSlice> first_slices(test::FakeServer& server) {
  std::vector<v1::ModulusSlice> first;
  for (const v1::ModulusSlice& slice : server.palpation.slices())
    if (std::ranges::none_of(first, [&](const v1::ModulusSlice& other) {
          return other.pose().origin_m(2) == slice.pose().origin_m(2);
        }))
      first.push_back(slice);
  return first;
}

std::vector<double> places_of(const std::vector<v1::ModulusSlice>& slices) {
  std::vector<double> z_m;
  for (const v1::ModulusSlice& slice : slices) z_m.push_back(slice.pose().origin_m(2));
  return z_m;
}

void expect_places(const std::vector<v1::ModulusSlice>& slices, const std::vector<double>& z_m) {
  const std::vector<double> found = places_of(slices);
  ASSERT_EQ(found.size(), z_m.size());
  for (std::size_t n = 0; n < z_m.size(); ++n) EXPECT_NEAR(found[n], z_m[n], 1e-12) << n;
}

TEST(AcquireSlices, TakesThemAllAndPublishesEachWhereItWasTaken) {
  test::FakeServer server;
  NumberedSlices frames(5, 2);
  AcquireOptions options = options_of(5);
  options.planner.lookahead = 1;
  std::atomic<bool> stop{false};
  AcquireObserver observer;
  std::size_t ready_after = 0;
  std::vector<std::uint64_t> versions;
  observer.slice = [&](std::size_t, std::uint64_t version) { versions.push_back(version); };
  observer.ready = [&] { ready_after = first_slices(server).size(); };
  AcquireSession session(server.address(), {}, frames, options, observer);
  const AcquireResult result = session.run(stop);
  EXPECT_EQ(result.windows.size(), 5u);
  EXPECT_GE(ready_after, 2u);
  EXPECT_EQ(versions.size(), 5u);
  EXPECT_TRUE(std::ranges::is_sorted(versions));
  const auto slices = first_slices(server);
  expect_places(slices, {-0.01, -0.005, 0, 0.005, 0.01});
  for (std::size_t n = 0; n < slices.size(); ++n) {
    const v1::Array& pa = slices[n].modulus().youngs_modulus_pa();
    ASSERT_EQ(pa.data().size(), sizeof(float) * 10 * 20);
    float first = 0;
    std::memcpy(&first, pa.data().data(), sizeof first);
    EXPECT_NEAR(first, 1e4 + 1e3 * double(n), 1) << "a slice was published with another's frames";
    EXPECT_EQ(slices[n].youngs_modulus_log_std().data().size(), pa.data().size());
    EXPECT_EQ(frames.frames_left(n), 1u) << "one acquisition of each";
  }
  for (const auto& call : server.elastography.calls()) {
    EXPECT_EQ(call.acquisition.plane(), v1::PLANE_CONDITION_SOLID);
    EXPECT_FALSE(call.acquisition.has_publish());
    EXPECT_EQ(call.acquisition.probe_elevation_m(), 0.012);
    EXPECT_EQ(call.acquisition.tissue_depth_m(), 0.02);
  }
  EXPECT_EQ(session.planes().size(), 5u);
}

// Each is estimated knowing those beside it, and once more, with its own frames, when one comes that it did
// not know.
TEST(AcquireSlices, CorrectThoseBeforeThem) {
  test::FakeServer server;
  NumberedSlices frames(5, 1);
  std::atomic<bool> stop{false};
  AcquireObserver observer;
  std::vector<std::size_t> corrected;
  observer.corrected = [&](std::size_t slice, std::uint64_t, const v1::EstimateSummary&) {
    corrected.push_back(slice);
  };
  AcquireSession session(server.address(), {}, frames, options_of(5), observer);
  EXPECT_EQ(session.run(stop).windows.size(), 5u) << "a correction is no new slice";
  EXPECT_EQ(corrected, (std::vector<std::size_t>{0, 1, 2, 3}));
  const auto calls = server.elastography.calls();
  ASSERT_EQ(calls.size(), 9u);
  std::vector<int> times(5, 0);
  for (std::size_t n = 0; n < calls.size(); ++n) {
    const v1::Acquisition& a = calls[n].acquisition;
    const auto slice = static_cast<std::size_t>(calls[n].pre[0]);
    ++times[slice];
    EXPECT_TRUE(n >= 5 || slice == n) << "those that are still to be taken come first";
    EXPECT_EQ(a.has_slice_of(), n > 0) << "there is no scene before the first";
    if (n == 0) continue;
    EXPECT_EQ(a.slice_of().scene_id(), "s");
    EXPECT_NEAR(a.slice_of().window().origin_m(2), -0.01 + 0.005 * double(slice), 1e-12);
  }
  EXPECT_EQ(times, (std::vector<int>{2, 2, 2, 2, 1}));
  EXPECT_EQ(server.palpation.slices().size(), 9u);
}

// Its force would fade while the model is made anew.
TEST(AcquireSlices, AreNotCorrectedUnderAFinger) {
  test::FakeServer server;
  NumberedSlices frames(4, 1);
  AcquireOptions options = options_of(4);
  server.palpation.set_finger(true, 0.01, 0, -0.01, 0);
  std::atomic<bool> stop{false}, lifted{false};
  std::atomic<int> corrected{0};
  AcquireObserver observer;
  observer.corrected = [&](std::size_t, std::uint64_t, const v1::EstimateSummary&) {
    EXPECT_TRUE(lifted);
    ++corrected;
  };
  std::thread lifts([&] {
    EXPECT_TRUE(comes([&] { return first_slices(server).size() == 4; }));
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    lifted = true;
    server.palpation.set_finger(false, 0.01, 0, -0.01, 0);
  });
  AcquireSession session(server.address(), {}, frames, options, observer);
  EXPECT_EQ(session.run(stop).windows.size(), 4u);
  lifts.join();
  EXPECT_EQ(corrected, 3);
}

// One that cannot be corrected stays as it was, and is said.
TEST(AcquireSlices, ACorrectionThatFailsLeavesTheSlice) {
  test::FakeServer server;
  NumberedSlices frames(2, 1);
  std::atomic<bool> stop{false};
  std::vector<std::string> said;
  AcquireObserver observer;
  observer.slice = [&](std::size_t slice, std::uint64_t) {
    if (slice == 1) server.elastography.untracked_calls = 1;
  };
  observer.note = [&](const std::string& line) { said.push_back(line); };
  AcquireSession session(server.address(), {}, frames, options_of(2), observer);
  const AcquireResult result = session.run(stop);
  EXPECT_EQ(result.windows.size(), 2u);
  EXPECT_EQ(result.refused, 0u) << "its slice is there";
  EXPECT_EQ(server.palpation.slices().size(), 2u);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("could not be tracked"), std::string::npos) << said[0];
}

TEST(AcquireSlices, OneThatCannotBeEstimatedDoesNotEndTheOthers) {
  test::FakeServer server;
  server.elastography.untracked_calls = 1;
  NumberedSlices frames(3, 1);
  std::atomic<bool> stop{false};
  std::vector<std::string> said;
  AcquireObserver observer;
  observer.note = [&](const std::string& line) { said.push_back(line); };
  AcquireSession session(server.address(), {}, frames, options_of(3), observer);
  const AcquireResult result = session.run(stop);
  EXPECT_EQ(result.refused, 1u);
  expect_places(first_slices(server), {-0.005, 0});
  EXPECT_EQ(session.planes().count(0), 0u);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("could not be tracked"), std::string::npos) << said[0];
}

TEST(AcquireSlices, OutlivesAServiceThatIsNotThereForAWhile) {
  test::FakeServer server;
  server.elastography.unavailable_calls = 2;
  server.palpation.unavailable_slices = 2;
  server.palpation.slice_warnings = {"state: not kept"};
  NumberedSlices frames(3, 1);
  std::atomic<bool> stop{false};
  std::vector<std::string> said;
  AcquireObserver observer;
  observer.note = [&](const std::string& line) { said.push_back(line); };
  AcquireSession session(server.address(), {}, frames, options_of(3), observer);
  EXPECT_EQ(session.run(stop).windows.size(), 3u);
  EXPECT_EQ(std::count(said.begin(), said.end(), "warning: state: not kept"),
            server.palpation.slices().size() - 1)
      << "with the first the scene was made";
  expect_places(first_slices(server), {-0.01, -0.005, 0});
}

// GIVEN that the answer to the scene's making is lost, THEN its own scene goes on, and another's of the same
// name is left as it is.
TEST(AcquireSlices, GoesOnWithItsOwnSceneAndNotWithAnothers) {
  for (const bool anothers : {false, true}) {
    test::FakeServer server;
    if (anothers) server.create_scene("s");
    server.palpation.lost_scenes = 1;
    NumberedSlices frames(3, 1);
    std::atomic<bool> stop{false};
    AcquireSession session(server.address(), {}, frames, options_of(3), {});
    if (!anothers) {
      EXPECT_EQ(session.run(stop).windows.size(), 3u);
      continue;
    }
    try {
      session.run(stop);
      FAIL() << "slices went into somebody else's scene";
    } catch (const ServiceError& error) {
      EXPECT_EQ(error.code, grpc::StatusCode::ALREADY_EXISTS) << error.what();
    }
    EXPECT_TRUE(first_slices(server).empty());
  }
}

TEST(AcquireSlices, AServiceThatForgotTheSceneEndsIt) {
  test::FakeServer server;
  NumberedSlices frames(3, 1);
  std::atomic<bool> stop{false};
  AcquireObserver observer;
  observer.slice = [&](std::size_t, std::uint64_t) { server.palpation.forget_scenes(); };
  AcquireSession session(server.address(), {}, frames, options_of(3), observer);
  try {
    session.run(stop);
    FAIL() << "slices went nowhere";
  } catch (const ServiceError& error) {
    EXPECT_NE(std::string(error.what()).find("NOT_FOUND"), std::string::npos) << error.what();
  }
  EXPECT_EQ(session.planes().size(), 1u);
}

// It comes from the first slices, jumps to the last and goes back.
TEST(AcquireSlices, FollowsAFingerAcrossThePlane) {
  test::FakeServer server;
  NumberedSlices frames(7, 1);
  AcquireOptions options = options_of(7);
  options.planner.lookahead = 1;
  options.until_finger_leaves = true;
  options.finger_gone_s = 0.1;
  options.arm.settle_s = 0.2;  // time for what is told of the finger
  std::atomic<bool> stop{false};
  AcquireObserver observer;
  observer.slice = [&](std::size_t, std::uint64_t) {
    const std::size_t published = first_slices(server).size();
    if (published == 1) server.palpation.set_finger(true, 0.01, 0, 0.0199, -0.011);
    if (published == 7) server.palpation.set_finger(false, 0.01, 0, 0.01, 0);
  };
  AcquireSession session(server.address(), {}, frames, options, observer);
  session.run(stop);
  const std::vector<double> z_m = places_of(first_slices(server));
  ASSERT_EQ(z_m.size(), 7u);
  const auto when = [&](double z) {
    return std::find_if(z_m.begin(), z_m.end(), [z](double at) { return std::abs(at - z) < 1e-9; }) -
           z_m.begin();
  };
  EXPECT_LT(when(0.02), when(0.01)) << "the finger's own first";
  EXPECT_LT(when(0.015), when(0.005)) << "then what it comes to";
  // The arm has begun a second one, and at most a third, by the time that it is told of the finger.
  EXPECT_LE(when(0.02), 3);
  EXPECT_LE(when(0.015), 4) << "before what is nearest to where it was";
}

// The arm looks for more while each is being published, and takes none: it would only wait.
TEST(AcquireSlices, OneIsUnderWayAtATime) {
  test::FakeServer server;
  NumberedSlices frames(4, 1);
  std::atomic<bool> stop{false};
  int looks = 0;
  AcquireObserver observer;
  observer.slice = [&](std::size_t, std::uint64_t) {
    for (int k = 0; k < 2; ++k) {  // one may have begun before
      frames.asked_since = false;
      looks += comes([&] { return frames.asked_since.load(); });
    }
    EXPECT_EQ(std::size_t(frames.taken), first_slices(server).size());
  };
  AcquireSession session(server.address(), {}, frames, options_of(4), observer);
  EXPECT_EQ(session.run(stop).windows.size(), 4u);
  EXPECT_EQ(looks, 8);
}

// GIVEN a finger that rests on the first slice WHEN the service asks for the last one THEN that is taken
// before what lies nearer, once, however long it is asked for.
TEST(AcquireSlices, WhatTheServiceAsksForPassesTheOthers) {
  test::FakeServer server;
  NumberedSlices frames(7, 3);
  AcquireOptions options = options_of(7);
  options.until_finger_leaves = true;
  options.finger_gone_s = 0.1;
  options.arm.settle_s = 0.2;  // time for what is told of the finger
  std::atomic<bool> stop{false};
  std::atomic<int> asked{0};
  AcquireObserver observer;
  observer.note = [&](const std::string& line) {
    EXPECT_EQ(line, "asked for a slice at z = 19.2 mm: the force there may be off by 108 %");
    ++asked;
  };
  observer.slice = [&](std::size_t, std::uint64_t) {
    const std::size_t published = first_slices(server).size();
    if (published == 7) server.palpation.set_finger(false, 0.01, 0, -0.01, 0);
    if (published != 2) return;  // it is watched once it is there
    server.palpation.set_finger(true, 0.01, 0, -0.01, 0);
    server.palpation.set_wish(0.0192, 1.078);
    for (int looks = 0; looks < 20; ++looks) {  // by then it is told
      frames.asked_since = false;
      EXPECT_TRUE(comes([&] { return frames.asked_since.load(); }));
    }
  };
  AcquireSession session(server.address(), {}, frames, options, observer);
  session.run(stop);
  const std::vector<double> z_m = places_of(first_slices(server));
  ASSERT_EQ(z_m.size(), 7u);
  EXPECT_NEAR(z_m[2], 0.02, 1e-9);
  EXPECT_EQ(asked, 1);
  EXPECT_EQ(frames.taken, 7);
}

TEST(AcquireSlices, AWishThatMakesNoSenseIsIgnoredAndSaidOnce) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::pair<double, double>> wishes{{kNone, 1}, {0.0226, 1}, {-0.5, 1}, {0.02, kNone}};
  for (std::size_t first = 0; first < wishes.size(); ++first) {
    test::FakeServer server;
    NumberedSlices frames(7, 1);
    AcquireOptions options = options_of(7);
    options.until_finger_leaves = true;
    options.finger_gone_s = 0.1;
    std::atomic<bool> stop{false};
    std::atomic<int> ignored{0};
    AcquireObserver observer;
    observer.note = [&](const std::string& line) {
      EXPECT_TRUE(line.starts_with("ignored: a slice is asked for at z = ")) << line;
      ++ignored;
    };
    observer.slice = [&](std::size_t, std::uint64_t) {
      const std::size_t published = first_slices(server).size();
      const auto& [z_m, half_width] = wishes[(first + published - 1) % wishes.size()];
      server.palpation.set_wish(z_m, half_width);
      server.palpation.set_finger(published < 7, 0.01, 0, -0.01, 0);
      EXPECT_TRUE(published == 1 || comes([&] { return ignored > 0; }));
    };
    AcquireSession session(server.address(), {}, frames, options, observer);
    session.run(stop);
    expect_places(first_slices(server), {-0.01, -0.005, 0, 0.005, 0.01, 0.015, 0.02});
    EXPECT_EQ(ignored, 1);
  }
}

}  // namespace
}  // namespace teletact::client
