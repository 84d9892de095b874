// What a touch is told of a solid that grows slice by slice meanwhile.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <map>
#include <thread>
#include <utility>

#include "service/touch_plane/touch_session.h"
#include "tests/scene/stacks.h"
#include "tests/solver/block_stencil.h"

namespace teletact::service {
namespace {

// Of a finger that rests until corrections make its answer no better.
TouchAnswer rested(TouchSession& session, const Vector3& position_m) {
  TouchAnswer answer = session.solve(position_m);
  for (std::size_t made = 0; answer.contact.solve.improving && made < choices::kMaxCorrections;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    answer = session.solve(position_m);
    made += answer.contact.solve.iterations > 0;
  }
  return answer;
}

TEST(TouchedSlices, GrowAVolumeUnderTheFinger) {
  const auto scene = scene_of(stack({-0.012}));
  TouchSession session(scene, {}, test_device());
  const auto force = [&](double z_m) {
    const TouchAnswer answer = rested(session, {kBallX, 0.002, z_m});
    EXPECT_TRUE(answer.contact.solve.converged);
    EXPECT_EQ(answer.status, from_slices_m(*scene->snapshot()->modulus, z_m) > choices::kSliceReach
                                 ? TouchStatus::kDegraded
                                 : TouchStatus::kOk)
        << answer.warning;
    EXPECT_EQ(answer.model_version, scene->snapshot()->version);
    return -answer.contact.force_n[1];
  };
  const double soft = force(kBallZ);
  std::uint64_t version = scene->snapshot()->version;
  for (const double z_m : kPlaces) {
    const Published published = scene->publish(slice_at(z_m));
    EXPECT_GT(published.version, version);
    version = published.version;
    force(z_m);
  }
  EXPECT_GT(force(kBallZ), 1.1 * soft);
  std::vector<double> all{-0.012};
  all.insert(all.end(), kPlaces.begin(), kPlaces.end());
  TouchSession other(scene_of(stack(all)), {}, test_device());
  for (const double z_m : {kBallZ, -0.008, 0.012}) {
    const double fresh = -rested(other, {kBallX, 0.002, z_m}).contact.force_n[1];
    EXPECT_NEAR(force(z_m), fresh, 2 * choices::kSolidForceError * fresh) << z_m;
  }
}

// Beside what was measured the answer says so, and beside the solid there is none.
TEST(TouchedSlices, AContactThatLeavesThemIsNotTrusted) {
  TouchSession session(scene_of(stack({-0.002, 0.002})), {}, test_device());
  const auto at = [&](double z_m) { return session.solve({0.012, 0.001, z_m}); };
  EXPECT_EQ(at(0.0065).status, TouchStatus::kOk) << at(0.0065).warning;
  const TouchAnswer beyond = at(0.0075);
  EXPECT_EQ(beyond.status, TouchStatus::kDegraded);
  EXPECT_NE(beyond.warning.find("the nearest slice is 5.5 mm away"), std::string::npos) << beyond.warning;
  EXPECT_LT(beyond.contact.force_n[1], 0) << "the outermost slice goes on";
  EXPECT_FALSE(session.solve({0.012, -0.002, 0.0075}).foreseen);
  session.solve({0.012, choices::kLightTouch, 0.0065});
  EXPECT_TRUE(session.solve({0.012, -0.002, 0.0065}).foreseen);
  EXPECT_EQ(at(0.0185).status, TouchStatus::kNotCovered);
}

// In contact, above, and where the answer is not trusted; by what this touch tolerates.
TEST(TouchedSlices, AnAnswerAsksForTheSliceThatItLacks) {
  const auto scene = scene_of(stack({-0.002, 0.002}));
  TouchSession session(scene, {}, test_device());
  const auto wish = [](TouchSession& finger, double y_m, double z_m) {
    return finger.solve({0.012, y_m, z_m}).wish;
  };
  for (const double y_m : {0.001, -0.02, choices::kLightTouch}) {
    EXPECT_FALSE(wish(session, y_m, 0.0025)) << "over a slice";
    for (const double z_m : {0.0055, 0.0095}) {
      ASSERT_TRUE(wish(session, y_m, z_m)) << y_m;
      EXPECT_NEAR(wish(session, y_m, z_m)->z_m, z_m - 0.0005, 1e-12);
    }
    EXPECT_FALSE(wish(session, y_m, 0.0185)) << "beside the solid";
  }
  const TouchAnswer answer = session.solve({0.012, 0.001, 0.0055});
  EXPECT_NEAR(answer.wish->half_width, 1.96 * answer.log_deviation.value().all(), 1e-12);
  EXPECT_GT(answer.log_deviation->between, 0);
  EXPECT_EQ(answer.contact.budget.relative(ErrorTerm::kSlices), answer.log_deviation->between);
  EXPECT_EQ(answer.contact.budget.relative(ErrorTerm::kModulus), answer.log_deviation->measured);
  TouchOptions lenient;
  lenient.tolerance = Tolerance{0.4, 0};
  TouchSession other(scene, lenient, test_device());
  EXPECT_FALSE(wish(other, 0.001, 0.0055));
  EXPECT_TRUE(wish(other, 0.001, 0.0095));
  scene->publish(slice_at(0.005));
  EXPECT_FALSE(wish(session, 0.001, 0.0055));
  EXPECT_TRUE(wish(session, 0.001, 0.0095));
  TouchSession throughout(scene_of([] {
                            ExplicitModulus e = grid();
                            e.youngs_modulus_pa.assign(24 * 10 * 18, 1e4);
                            return e;
                          }()),
                          {}, test_device());
  EXPECT_FALSE(wish(throughout, 0.001, 0.0095)) << "nothing is missing";
}

// A lump beyond the end would be felt: by more than a few percent only from near by.
TEST(TouchedSlices, NearAnEndTheAnswerSaysWhatMayLieBeyond) {
  TouchSession session(scene_of(stack(kPlaces)), {}, test_device());
  const auto said = [&](double x_m) { return session.solve({x_m, 5e-4, kBallZ}).warning; };
  EXPECT_EQ(said(0.024).find("ends the tissue that was given"), std::string::npos) << said(0.024);
  EXPECT_NE(said(0.043).find("5 mm from here ends the tissue that was given"), std::string::npos)
      << said(0.043);
}

// While a newer version is made ready the one before answers, and is judged by its own slices.
TEST(TouchedSlices, TheVersionBeforeIsNotTrustedForANewSlice) {
  const auto scene = scene_of(stack({-0.01}));
  TouchSession session(scene, {}, test_device());
  const Vector3 pose{0.012, 0.001, 0.008};
  EXPECT_EQ(session.solve(pose).status, TouchStatus::kDegraded);
  scene->publish(slice_at(0.008));
  const auto wait = [](const WindowModel&) { return false; };
  const TouchAnswer before = session.solve(pose, wait);
  EXPECT_EQ(before.model_version, 1u);
  EXPECT_EQ(before.status, TouchStatus::kDegraded);
  EXPECT_NE(before.warning.find("the nearest slice is 18.0 mm away"), std::string::npos) << before.warning;
  EXPECT_EQ(session.solve(pose).status, TouchStatus::kOk);
}

// Slices that come before the solid was ever ready do not begin it anew: what was begun for an older version
// serves the newest.
TEST(TouchedSlices, ThatComeWhileTheSolidIsMadeReadyDoNotDelayIt) {
  const auto scene = scene_of(stack({-0.01}));
  std::vector<std::function<void()>> jobs;
  scene->set_touch_work(
      [&](const std::string&, std::function<void()> job) { jobs.push_back(std::move(job)); });
  const TouchOptions by_nodes{.fingertip = {}, .path = SolvePath::kGradients};
  TouchSession session(scene, by_nodes, test_device());
  const Vector3 pose{kBallX, 0.002, kBallZ};
  EXPECT_EQ(session.solve(pose).status, TouchStatus::kPreparing);
  ASSERT_EQ(jobs.size(), 1u);
  scene->publish(slice_at(-0.002));
  scene->publish(slice_at(kBallZ));
  EXPECT_EQ(session.solve(pose).status, TouchStatus::kPreparing);
  scene->publish(slice_at(0.01));
  for (const auto& job : std::exchange(jobs, {})) job();
  const TouchAnswer answer = session.solve(pose);
  EXPECT_EQ(answer.status, TouchStatus::kOk) << answer.warning;
  EXPECT_EQ(answer.model_version, 4u);
  EXPECT_TRUE(jobs.empty()) << "nothing was begun anew";
  TouchSession fresh(scene_of(*scene->snapshot()->modulus), by_nodes, test_device());
  const double truth = fresh.solve(pose).contact.force_n[1];
  EXPECT_NEAR(answer.contact.force_n[1], truth,
              (answer.contact.solve.relative_error + choices::kSolidForceError) * -truth);
}

// A slice comes while a finger presses: the version before answers until the new one has been corrected
// there.
TEST(TouchedSlices, APressedFingerDoesNotWaitForANewVersion) {
  const auto scene = scene_of(stack({-0.012, -0.002, 0.012}));
  scene->set_touch_work([](const std::string&, const std::function<void()>& job) { job(); });
  const TouchOptions by_nodes{.fingertip = {}, .path = SolvePath::kGradients};
  TouchSession session(scene, by_nodes, test_device());
  const Vector3 pose{kBallX, 0.002, kBallZ};
  EXPECT_EQ(session.solve(pose).status, TouchStatus::kPreparing) << "the layer is made beside";
  const TouchAnswer before = session.solve(pose);
  ASSERT_EQ(before.status, TouchStatus::kOk) << before.warning;
  scene->publish(slice_at(kBallZ));
  const TouchAnswer first = session.solve(pose);
  EXPECT_EQ(first.model_version, before.model_version) << "not corrected yet";
  EXPECT_NEAR(first.contact.force_n[1], before.contact.force_n[1],
              2 * choices::kSolidForceError * -before.contact.force_n[1]);
  const auto published = std::chrono::steady_clock::now();
  TouchAnswer answer = first;
  while (answer.model_version == before.model_version &&
         std::chrono::steady_clock::now() < published + std::chrono::seconds(20)) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    answer = session.solve(pose);
    ASSERT_EQ(answer.status, TouchStatus::kOk) << answer.warning;
  }
  EXPECT_EQ(answer.model_version, before.model_version + 1);
  EXPECT_LT(answer.contact.force_n[1], 1.05 * before.contact.force_n[1]) << "the slice is stiffer";
  TouchSession above(scene, by_nodes, test_device());
  const Vector3 lifted{kBallX, -0.002, kBallZ};
  above.solve(lifted);
  scene->publish(slice_at(0.008));
  EXPECT_EQ(above.solve(lifted).model_version, before.model_version + 2) << "nothing is waited for";
}

// GIVEN a finger that feels a law, WHEN a new version comes, THEN its law is waited for from when it would
// answer well, and no longer than whoever waits for it says.
TEST(TouchedSlices, TheWaitForALawIsHeeded) {
  const auto scene = scene_of(stack({-0.012, -0.002, 0.012}));
  scene->set_touch_work([](const std::string&, const std::function<void()>& job) { job(); });
  TouchSession session(scene, {.fingertip = {}, .path = SolvePath::kGradients}, test_device());
  double x_m = kBallX - 0.004;
  int asked = 0;
  const auto solve = [&] {
    return session.solve({x_m += 1e-4, 0.002, kBallZ}, [&](const WindowModel&) { return ++asked > 3; });
  };
  session.solve({x_m, 0.002, kBallZ});
  const TouchAnswer before = solve();
  ASSERT_EQ(before.status, TouchStatus::kOk) << before.warning;
  scene->publish(slice_at(kBallZ));
  TouchAnswer answer = before;
  const auto published = std::chrono::steady_clock::now();
  while (asked <= 3 && std::chrono::steady_clock::now() < published + std::chrono::seconds(20)) {
    EXPECT_EQ(answer.model_version, before.model_version);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    answer = solve();
  }
  EXPECT_EQ(answer.model_version, before.model_version + 1) << "as soon as it may";
  EXPECT_EQ(answer.status, TouchStatus::kOk) << answer.warning;
}

// A wait for a correction takes the force away from a finger that presses; one that is put down has none yet.
TEST(TouchedSlices, AFingerThatPressesOnWaitsForNoCorrection) {
  TouchSession session(scene_of(stack({kBallZ})), {}, test_device());
  const auto told = [&](double x_m) { return session.solve({x_m, 0.002, kBallZ}).contact.solve; };
  EXPECT_TRUE(told(kBallX).converged) << "put down";
  const SolveReport on = told(kBallX - 0.004);
  EXPECT_TRUE(!on.converged && on.improving);
  std::this_thread::sleep_for(choices::kPressesOn);
  EXPECT_TRUE(told(kBallX + 0.004).converged) << "put down anew";
  EXPECT_TRUE(told(kBallX - 0.005).converged) << "put down elsewhere";
}

// Slices come while a finger presses: each answer is one version's, whole, within what it states.
TEST(TouchedSlices, APressedFingerFeelsWholeVersions) {
  const auto scene = scene_of(stack({-0.012, -0.002, 0.012}));
  const Vector3 pose{kBallX, 0.002, kBallZ};
  std::map<std::uint64_t, std::shared_ptr<const WindowModel>> versions;
  const auto keep = [&] {
    const auto window = scene->snapshot()->windows.front();
    versions[window->version] = window;
  };
  std::vector<TouchAnswer> answers;
  std::atomic<bool> stop{false}, begun{false};
  TouchSession session(scene, {}, test_device());
  session.solve(pose);
  std::thread finger([&] {
    while (!stop) {
      answers.push_back(session.solve(pose));
      begun = true;
    }
  });
  while (!begun) std::this_thread::yield();
  keep();
  for (int turn = 0; turn < 6; ++turn) {
    scene->publish(slice_at(kBallZ, kBallX, turn % 2 ? 1e4 : 8e4));
    keep();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  stop = true;
  finger.join();
  std::map<std::uint64_t, double> alone;
  for (const auto& [version, window] : versions) {
    TouchWay way;
    way.device = test_device();
    const auto layer = window->model->layer(Layer{}, way, {});
    alone[version] = -layer->answer({}, {pose}).force_n[1];
  }
  double least = HUGE_VAL, most = 0;
  for (const auto& [version, force] : alone) least = std::min(least, force), most = std::max(most, force);
  EXPECT_GT(most, 1.05 * least) << "the slices differ";
  std::uint64_t last = 0;
  for (const TouchAnswer& answer : answers) {
    const SolveReport& solve = answer.contact.solve;
    ASSERT_TRUE(answer.status == TouchStatus::kOk || solve.improving) << answer.warning;
    EXPECT_GE(answer.model_version, last);
    last = answer.model_version;
    const double force = alone.at(answer.model_version);
    EXPECT_NEAR(-answer.contact.force_n[1], force,
                (solve.relative_error + 2 * choices::kSolidForceError) * force)
        << last;
  }
  EXPECT_GT(last, answers.front().model_version);
}

// What was learned of the modulus before says nothing of this one: the error that is stated covers.
TEST(TouchedSlices, WhatAnAnswerStatesCoversRightAfterOne) {
  const auto scene = scene_of(stack({-0.01, 0.01}));
  TouchWay way;
  way.device = test_device();
  way.path = SolvePath::kGradients;
  const TouchPose pose{{kBallX, 0.002, kBallZ}};
  const auto layer = [&] { return scene->snapshot()->windows.front()->model->layer(Layer{}, way, {}); };
  const auto settled = [&](TouchedLayer& touched) {
    if (const auto job = touched.wanted({}, pose, 0)) {
      EXPECT_TRUE(job->work(TouchedLayer::Clock::now() + std::chrono::seconds(20)));
    }
    return touched.answer({}, pose);
  };
  const double before = -settled(*layer()).force_n[1];
  scene->publish(slice_at(kBallZ));
  const ContactAnswer first = layer()->answer({}, pose), answer = settled(*layer());
  const auto fresh = scene_of(*scene->snapshot()->modulus)->snapshot()->windows.front()->model;
  const double truth = -settled(*fresh->layer(Layer{}, way, {})).force_n[1];
  EXPECT_FALSE(first.solve.converged);
  EXPECT_NEAR(-first.force_n[1], truth, first.solve.relative_error * truth);
  EXPECT_GT(truth, 1.05 * before);
  EXPECT_GT(answer.solve.iterations, 0u) << "solved anew";
  EXPECT_NEAR(-answer.force_n[1], truth, (answer.solve.relative_error + choices::kSolidForceError) * truth);
}

// The factor's layers drift away from the tissue's, and with them the skin and what lies beyond the block:
// they are made anew by themselves, and then nothing tells how the solid came to be.
TEST(TouchedSlices, AWornFactorIsRenewed) {
  const auto scene = scene_of(stack({-0.01}));
  TouchSession session(scene, {}, test_device());
  const auto touched = [](TouchSession& finger) {
    const TouchAnswer answer = rested(finger, {kBallX, 0.002, 0.001});
    return std::pair{-answer.contact.force_n[1], answer.contact.solve.relative_error};
  };
  // Within what is stated, and how far that is from what is asked.
  const auto felt_as_made_anew = [&] {
    TouchSession fresh(scene_of(*scene->snapshot()->modulus), {}, test_device());
    const double truth = touched(fresh).first;
    const auto [force, stated] = touched(session);
    EXPECT_NEAR(force, truth, (stated + choices::kSolidForceError) * truth);
    return stated - choices::kSolidForceError;
  };
  touched(session);
  ModulusSlice slice = slice_at(0.01);
  scene->publish(slice);
  EXPECT_FALSE(scene->renewed()) << "next to nothing changed";
  for (double& e : slice.youngs_modulus_pa) e *= 4;  // all layers alike: S0 is scaled
  scene->publish(slice);
  EXPECT_FALSE(scene->renewed());
  EXPECT_LT(felt_as_made_anew(), 0.1 * choices::kMaxDrift);
  for (std::size_t n = 24 * 5; n < 24 * 10; ++n) slice.youngs_modulus_pa[n] *= 6;
  scene->publish(slice);
  EXPECT_GT(felt_as_made_anew(), 0.01);
  const TouchAnswer worn = rested(session, {kBallX, 0.002, 0.001});
  EXPECT_EQ(worn.status, TouchStatus::kDegraded);
  EXPECT_NE(worn.warning.find("layers changed"), std::string::npos) << worn.warning;
  const auto renewed = scene->renewed();
  ASSERT_TRUE(renewed);
  ModulusSlice between{0.001, {}, {}, {}};  // while it was made: what is there already, 1.3 times as hard
  for (std::size_t n = 0; n < slice.youngs_modulus_pa.size(); ++n)
    between.youngs_modulus_pa.push_back(1.3 * std::pow(slice_at(-0.01).youngs_modulus_pa[n], 0.45) *
                                        std::pow(slice.youngs_modulus_pa[n], 0.55));
  scene->publish(between);
  scene->renew(*renewed);
  EXPECT_EQ(scene->snapshot()->version, 6u);
  EXPECT_EQ(rested(session, {kBallX, 0.002, 0.001}).status, TouchStatus::kOk);
  EXPECT_LE(felt_as_made_anew(), 0.1 * choices::kMaxDrift);
  EXPECT_FALSE(scene->renewed());
}

// A lump at the end of what is given goes on around it, up to where the other end's goes on.
TEST(TouchedSlices, ALumpOnTheSeamIsFeltAlikeFromBothSides) {
  const auto with = [](bool mirrored, double ball_x) {
    std::vector<ModulusSlice> slices;
    for (const double z_m : kPlaces) {
      ModulusSlice s = slice_at(mirrored ? -z_m : z_m, mirrored ? kWidthM - ball_x : ball_x);
      s.youngs_modulus_pa = slice_at(z_m + kBallZ - 0.018, ball_x).youngs_modulus_pa;
      if (mirrored)
        for (int j = 0; j < 10; ++j)
          std::reverse(s.youngs_modulus_pa.begin() + 24 * j, s.youngs_modulus_pa.begin() + 24 * (j + 1));
      slices.push_back(std::move(s));
    }
    return scene_of(stacked(grid(), slices, Limits{}));
  };
  TouchSession plain(with(false, kWidthM), {}, test_device()), turned(with(true, kWidthM), {}, test_device());
  TouchSession soft(with(false, 1.0), {}, test_device());
  const TouchAnswer a = plain.solve({kWidthM - 0.003, 0.002, 0.013});
  const TouchAnswer b = turned.solve({0.003, 0.002, -0.013});
  const TouchAnswer c = soft.solve({kWidthM - 0.003, 0.002, 0.013});
  for (const TouchAnswer* answer : {&a, &b, &c})
    ASSERT_EQ(answer->status, TouchStatus::kOk) << answer->warning;
  EXPECT_GT(a.contact.force_n[1] / c.contact.force_n[1], 1.1);
  const double slack = 2 * choices::kSolidForceError * -a.contact.force_n[1];
  EXPECT_NEAR(a.contact.force_n[1], b.contact.force_n[1], slack);
  EXPECT_NEAR(a.contact.force_n[0], -b.contact.force_n[0], slack);
  EXPECT_NEAR(a.contact.force_n[2], -b.contact.force_n[2], slack);
}

}  // namespace
}  // namespace teletact::service
