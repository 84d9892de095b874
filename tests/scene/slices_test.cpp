// Solids that grow slice by slice: what they are made of, what a touch is told meanwhile, and what is
// refused.
#include "service/scene/slices.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <thread>

#include "service/scene/errors.h"
#include "service/scene/solid_block.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/windows.h"
#include "tests/solver/block_stencil.h"

namespace teletact::service {
namespace {

constexpr double kWidthM = 0.048, kDepthM = 0.030, kBallX = 0.024, kBallZ = 0.002;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// 24 x 10 elements of 2 x 3 mm; 18 of 2 mm along z.
ExplicitModulus grid() {
  ExplicitModulus e;
  for (int i = 0; i <= 24; ++i) e.x_m.push_back(kWidthM * i / 24);
  for (int j = 0; j <= 10; ++j) e.y_m.push_back(kDepthM * j / 10);
  for (int k = 0; k <= 18; ++k) e.z_m.push_back(-0.018 + 0.002 * k);
  return e;
}

// What a plane of 10 kPa shows at z of a ball of radius 6 mm, eight times as hard, 9 mm deep.
ModulusSlice slice_at(double z_m, double ball_x = kBallX, double hard = 8e4) {
  ModulusSlice slice{z_m, {}, {}, {}};
  for (int j = 0; j < 10; ++j)
    for (int i = 0; i < 24; ++i) {
      const double x = 0.002 * (i + 0.5) - ball_x, y = 0.003 * (j + 0.5) - 0.009;
      slice.youngs_modulus_pa.push_back(std::hypot(x, y, z_m - kBallZ) < 0.006 ? hard : 1e4);
    }
  return slice;
}
std::vector<ModulusSlice> slices_at(const std::vector<double>& places) {
  std::vector<ModulusSlice> out;
  for (const double z_m : places) out.push_back(slice_at(z_m));
  return out;
}
ExplicitModulus stack(const std::vector<double>& places) {
  return stacked(grid(), slices_at(places), Limits{});
}
std::shared_ptr<Scene> scene_of(const ExplicitModulus& e, const MemoryAccount& account = {}) {
  return std::make_shared<Scene>("s", tissue(kWidthM, kDepthM), e, versions(), Limits{}, account);
}

std::string why(const std::function<void()>& work) {
  try {
    work();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "taken";
}

const std::vector<double> kPlaces{-0.015, -0.01, -0.006, -0.002, 0.002, 0.0061, 0.01, 0.015};

TEST(Slices, BetweenThemLnEIsInterpolatedAndTheOutermostGoOn) {
  const ExplicitModulus e = stack({0.003, -0.005});  // in any order
  EXPECT_EQ(e.slices_m, (std::vector<double>{-0.005, 0.003}));
  const SolidBlock block = solid_block(tissue(kWidthM, kDepthM), e);
  const SolidGrid& g = block.tissue.grid;
  const auto at = [&](std::size_t k) { return block.tissue.youngs_modulus_pa[11 + g.nx * (k + g.nz * 3)]; };
  const double first = slice_at(-0.005).youngs_modulus_pa[11 + 24 * 3],
               last = slice_at(0.003).youngs_modulus_pa[11 + 24 * 3];
  ASSERT_NE(first, last);
  for (std::size_t k = 0; k < 18; ++k) {
    const double z_m = -0.018 + 0.002 * (double(k) + 0.5);
    const double share = std::clamp((z_m + 0.005) / 0.008, 0.0, 1.0);
    EXPECT_NEAR(std::log(at(k)), std::log(first) + share * std::log(last / first), 1e-9) << z_m;
  }
  EXPECT_DOUBLE_EQ(at(18), last);  // around it the outermost go on, each to the middle
  EXPECT_DOUBLE_EQ(at(g.nz - 1), first);
}

TEST(Slices, OneByOneTheyMakeWhatTheyMakeTogether) {
  ExplicitModulus grown = stack({kPlaces[3]});
  SolidBlock block = solid_block(tissue(kWidthM, kDepthM), grown);
  for (const std::size_t n : {5, 0, 7, 1, 6, 2, 4, 2}) {  // the last in another one's place
    GrownModulus next = with_slice(grown, slice_at(kPlaces[n]), Limits{});
    grown = std::move(next.modulus);
    EXPECT_EQ(grown.slices_m[next.slice], kPlaces[n]);
    block = solid_block(block, grown, next.slice);
    EXPECT_EQ(block.tissue.youngs_modulus_pa,
              solid_block(tissue(kWidthM, kDepthM), grown).tissue.youngs_modulus_pa);
  }
  const ExplicitModulus together = stack(kPlaces);
  EXPECT_EQ(grown.slices_m, together.slices_m);
  EXPECT_EQ(grown.youngs_modulus_pa, together.youngs_modulus_pa);
}

// A solid given throughout takes slices too: its own are in the middle of its elements.
TEST(Slices, AreTakenByASolidThatWasGivenThroughout) {
  ExplicitModulus e = grid();
  e.youngs_modulus_pa.assign(24 * 10 * 18, 1e4);
  EXPECT_EQ(from_slices_m(e, 0.5), 0);
  const GrownModulus grown = with_slice(e, slice_at(0.001), Limits{});
  EXPECT_EQ(grown.modulus.slices(), 18u) << "at 1 mm it had one";
  EXPECT_EQ(grown.slice, 9u);
  EXPECT_EQ(with_slice(e, slice_at(0.0005), Limits{}).modulus.slices(), 19u);
  e.z_m = {-0.018, 0, 0.018};  // coarse ones: each is its element's
  e.youngs_modulus_pa.resize(24 * 10 * 2);
  const ExplicitModulus coarse = with_slice(e, slice_at(0.0), Limits{}).modulus;
  for (const double z_m : {-0.0179, -0.001, 0.0135}) EXPECT_EQ(from_slices_m(coarse, z_m), 0) << z_m;
}

TEST(Slices, AreRefusedByName) {
  const ExplicitModulus solid = stack({0});
  const auto refused = [&](auto change, const char* field) {
    ModulusSlice slice = slice_at(0.004);
    change(slice);
    EXPECT_EQ(why([&] { with_slice(solid, slice, Limits{}); }).rfind(field, 0), 0u)
        << field << " / " << why([&] { with_slice(solid, slice, Limits{}); });
  };
  for (const double z_m : {0.0181, -0.1, kNan, HUGE_VAL})
    refused([z_m](ModulusSlice& s) { s.z_m = z_m; }, "slice.pose.origin_m[2]");
  for (const double e : {0.0, -1.0, 0.99, 1.01e12, 1e300, kNan, HUGE_VAL})
    refused([e](ModulusSlice& s) { s.youngs_modulus_pa[7] = e; }, "slice.modulus.youngs_modulus_pa[7]");
  refused([](ModulusSlice& s) { s.youngs_modulus_pa.pop_back(); }, "slice.modulus.youngs_modulus_pa");
  refused([](ModulusSlice& s) { s.x_m = grid().x_m, s.x_m[3] += 1e-4; }, "slice.modulus.x_m");
  refused([](ModulusSlice& s) { s.y_m = grid().y_m, s.y_m.pop_back(); }, "slice.modulus.y_m");
  ModulusSlice same = slice_at(0.004);
  same.x_m = grid().x_m, same.y_m = grid().y_m;
  EXPECT_EQ(with_slice(solid, same, Limits{}).modulus.slices(), 2u);
  const auto stacks = [](const std::vector<ModulusSlice>& slices) {
    return why([&] { stacked(grid(), slices, Limits{}); });
  };
  EXPECT_EQ(stacks({}).rfind("slices: none", 0), 0u);
  EXPECT_EQ(stacks(slices_at({0, 0.004, 5e-6})).rfind("slices[2].pose.origin_m[2]", 0), 0u);
  EXPECT_EQ(stacks(slices_at({0, 0.5})).rfind("slices[1].pose.origin_m[2]", 0), 0u);
  Limits few;
  few.most_solid_elements = 3 * 24 * 10;
  EXPECT_EQ(why([&] { stacked(grid(), slices_at({0, 1e-3, 2e-3, 3e-3}), few); }).rfind("slices: 4", 0), 0u);
  const ExplicitModulus full = stacked(grid(), slices_at({0, 1e-3, 2e-3}), few);
  EXPECT_EQ(why([&] { with_slice(full, slice_at(5e-3), few); }).rfind("slices: 4", 0), 0u);
  EXPECT_EQ(with_slice(full, slice_at(1e-3), few).modulus.slices(), 3u) << "in another's place";
  const auto plane = std::make_shared<Scene>("p", tissue(kWidthM, kDepthM), versions());
  EXPECT_THROW(plane->publish(slice_at(0)), Error);
}

TEST(Slices, GrowAVolumeUnderTheFinger) {
  const auto scene = scene_of(stack({-0.012}));
  TouchSession session(scene, {}, test_device());
  const auto force = [&](double z_m) {
    TouchAnswer answer = session.solve({kBallX, 0.002, z_m});
    for (int rests = 0; rests < 2000 && !answer.contact.solve.converged; ++rests) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      answer = session.solve({kBallX, 0.002, z_m});
    }
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
    const double fresh = -other.solve({kBallX, 0.002, z_m}).contact.force_n[1];
    EXPECT_NEAR(force(z_m), fresh, 2 * choices::kSolidForceError * fresh) << z_m;
  }
}

// Beside what was measured the answer says so, and beside the solid there is none.
TEST(Slices, AContactThatLeavesThemIsNotTrusted) {
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

// While a newer version is made ready the one before answers, and is judged by its own slices.
TEST(Slices, TheVersionBeforeIsNotTrustedForANewSlice) {
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
TEST(Slices, ThatComeWhileTheSolidIsMadeReadyDoNotDelayIt) {
  const auto scene = scene_of(stack({-0.01}));
  std::vector<std::function<void()>> jobs;
  scene->set_touch_work(
      [&](const std::string&, std::function<void()> job) { jobs.push_back(std::move(job)); });
  TouchSession session(scene, {}, test_device());
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
  TouchSession fresh(scene_of(*scene->snapshot()->modulus), {}, test_device());
  const double truth = fresh.solve(pose).contact.force_n[1];
  EXPECT_NEAR(answer.contact.force_n[1], truth,
              (answer.contact.solve.relative_error + choices::kSolidForceError) * -truth);
}

// Slices come while a finger presses: each answer is one version's, whole, within what it states.
TEST(Slices, APressedFingerFeelsWholeVersions) {
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
    alone[version] = -layer->touch({}, {pose}).force_n[1];
  }
  double least = HUGE_VAL, most = 0;
  for (const auto& [version, force] : alone) least = std::min(least, force), most = std::max(most, force);
  EXPECT_GT(most, 1.05 * least) << "the slices differ";
  std::uint64_t last = 0;
  for (const TouchAnswer& answer : answers) {
    ASSERT_EQ(answer.status, TouchStatus::kOk) << answer.warning;
    EXPECT_GE(answer.model_version, last);
    last = answer.model_version;
    const double force = alone.at(answer.model_version);
    EXPECT_NEAR(-answer.contact.force_n[1], force, 2 * choices::kSolidForceError * force) << last;
  }
  EXPECT_GT(last, answers.front().model_version);
}

// What was learned of the modulus before says nothing of this one: the error that is stated covers.
TEST(Slices, WhatAnAnswerStatesCoversRightAfterOne) {
  const auto scene = scene_of(stack({-0.01, 0.01}));
  TouchWay way;
  way.device = test_device();
  const TouchPose pose{{kBallX, 0.002, kBallZ}};
  const auto layer = [&] { return scene->snapshot()->windows.front()->model->layer(Layer{}, way, {}); };
  const auto settled = [&](TouchedLayer& touched) {
    EXPECT_TRUE(touched.prepare({}, pose, 0, TouchedLayer::Clock::now() + std::chrono::seconds(20)));
    return touched.touch({}, pose);
  };
  const double before = -settled(*layer()).force_n[1];
  scene->publish(slice_at(kBallZ));
  const ContactAnswer first = layer()->touch({}, pose), answer = settled(*layer());
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
TEST(Slices, AWornFactorIsRenewed) {
  const auto scene = scene_of(stack({-0.01}));
  TouchSession session(scene, {}, test_device());
  const auto touched = [](TouchSession& finger) {
    const ContactAnswer answer = finger.solve({kBallX, 0.002, 0.001}).contact;
    return std::pair{-answer.force_n[1], answer.solve.relative_error};
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
  EXPECT_LT(felt_as_made_anew(), 0.1 * choices::kMostDrift);
  for (std::size_t n = 24 * 5; n < 24 * 10; ++n) slice.youngs_modulus_pa[n] *= 6;
  scene->publish(slice);
  EXPECT_GT(felt_as_made_anew(), 0.01);
  const TouchAnswer worn = session.solve({kBallX, 0.002, 0.001});
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
  EXPECT_EQ(session.solve({kBallX, 0.002, 0.001}).status, TouchStatus::kOk);
  EXPECT_LE(felt_as_made_anew(), 0.1 * choices::kMostDrift);
  EXPECT_FALSE(scene->renewed());
}

// A lump at the end of what is given goes on around it, up to where the other end's goes on.
TEST(Slices, ALumpOnTheSeamIsFeltAlikeFromBothSides) {
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

TEST(Slices, AreChargedAndGivenBackAndWithoutRoomNothingChanges) {
  Limits limits;
  limits.host_memory_bytes = limits.device_memory_bytes = std::uint64_t{64} << 20;
  limits.client_memory_share = 1;
  const auto budget = std::make_shared<MemoryBudget>(limits);
  auto scene = scene_of(stack({0}), {budget, "", "s"});
  const std::uint64_t one = budget->held(Place::kHost);
  scene->publish(slice_at(0.004));
  EXPECT_EQ(budget->held(Place::kHost), one + (24 * 10 + 1) * sizeof(double)) << "the one before is gone";
  const Charge rest =
      MemoryAccount{budget}.charge(Place::kHost, "test", limits.host_memory_bytes - one - 100000);
  const auto before = scene->snapshot();
  EXPECT_THROW(scene->publish(slice_at(0.008)), MemoryRefused);
  EXPECT_EQ(scene->snapshot(), before);
  scene.reset();
}

TEST(Slices, AreKeptOnDisk) {
  const auto scene = scene_of(stack({-0.01, 0.01}));
  scene->publish(slice_at(0.001));
  const EncodedScene kept = encoded(scene->record());
  const SceneRecord again = decoded(
      kept.description, [&](const std::string&) { return kept.map; }, Limits{});
  ASSERT_TRUE(again.explicit_modulus);
  EXPECT_EQ(again.explicit_modulus->slices_m, (std::vector<double>{-0.01, 0.001, 0.01}));
  EXPECT_EQ(again.explicit_modulus->youngs_modulus_pa, scene->snapshot()->modulus->youngs_modulus_pa);
  const auto restored = std::make_shared<Scene>(again, versions(), Limits{});
  TouchSession one(scene, {}, test_device()), other(restored, {}, test_device());
  const double force = one.solve({kBallX, 0.002, 0.0}).contact.force_n[1];
  EXPECT_NEAR(other.solve({kBallX, 0.002, 0.0}).contact.force_n[1], force, 2e-3 * std::abs(force));
  std::string broken = kept.description;
  broken.replace(broken.find("\"slices\": 3"), 11, "\"slices\": 9");
  EXPECT_THROW(decoded(
                   broken, [&](const std::string&) { return kept.map; }, Limits{}),
               std::runtime_error);
}

}  // namespace
}  // namespace teletact::service
