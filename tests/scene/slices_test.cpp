// Solids that grow slice by slice: what they are made of, and what is refused.
#include "service/scene/slices.h"

#include <gtest/gtest.h>

#include <cmath>

#include "service/base/squared.h"
#include "service/scene/between_slices.h"
#include "service/scene/errors.h"
#include "service/scene/tissue_models.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/stacks.h"
#include "tests/solver/block_stencil.h"

namespace teletact::service {
namespace {

constexpr double kFeltM = 0.0028;  // radius of a usual contact

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

TEST(Slices, AreExtrudedWhileAllAreEqual) {
  ExplicitModulus e = stack({0.015});
  EXPECT_TRUE(extruded(e)) << "one slice";
  e = with_slice(e, slice_at(-0.015), Limits{}).modulus;
  EXPECT_TRUE(extruded(e)) << "both beside the ball";
  EXPECT_FALSE(extruded(with_slice(e, slice_at(kBallZ), Limits{}).modulus));
  e = grid();
  e.youngs_modulus_pa.assign(24 * 10 * 18, 1e4);
  EXPECT_TRUE(extruded(e));
  e.youngs_modulus_pa.back() = 2e4;
  EXPECT_FALSE(extruded(e));
}

ModulusSlice uniform(double z_m, double pa, double deviation) {
  ModulusSlice slice{z_m, {}, {}, std::vector<double>(240, pa)};
  if (deviation > 0) slice.log_deviation.assign(240, deviation);
  return slice;
}

TEST(Slices, TheirDeviationGrowsBetweenThem) {
  const ExplicitModulus e =
      stacked(grid(), {uniform(-0.004, 1e4, 0.1), uniform(0.004, 3e4, 0), uniform(0.006, 3e4, 0.2)}, {});
  const auto at = [&](double z_m) { return felt_log_deviation(e, {kBallX, 0, z_m, kFeltM}).value(); };
  EXPECT_NEAR(at(-0.004).measured, 0.1, 1e-12);
  EXPECT_NEAR(at(0.004).measured, 0, 1e-12) << "exact where it states none";
  EXPECT_NEAR(at(0.006).measured, 0.2, 1e-12);
  // By hand: a quarter of the way; then amid.
  EXPECT_NEAR(at(-0.002).measured, std::sqrt(0.75 * 0.01), 1e-12);
  EXPECT_NEAR(at(0.005).measured, std::sqrt(0.5 * 0.04), 1e-12);
  // What lies between them is felt on a slice, too, and more the farther from it.
  for (const double z_m : {-0.004, -0.002, 0.0, 0.004, 0.005})
    EXPECT_NEAR(squared(at(z_m).between), felt_between_variance(e, {e.x_m, e.y_m, {kBallX, 0, z_m, kFeltM}}),
                1e-12);
  EXPECT_NEAR(at(0).all(), std::hypot(at(0).measured, at(0).between), 1e-12);
  for (double z_m = 0.006; z_m < 0.016; z_m += 0.001)
    EXPECT_LT(at(z_m).between, at(z_m + 0.0005).between) << z_m;
  EXPECT_GT(at(0.018).between, 0.9 * choices::kUnseenDeviation);
  EXPECT_LT(at(0.018).between, choices::kUnseenDeviation) << "no farther than what nobody measured";
  EXPECT_GT(at(0).between, at(0.005).between) << "amid a wide gap of slices that differ";
  ExplicitModulus throughout = grid();
  throughout.youngs_modulus_pa.assign(24 * 10 * 18, 1e4);
  EXPECT_FALSE(felt_log_deviation(throughout, {kBallX, 0, 0, kFeltM}));
}

// The middle of the elements there, which are 2 mm along z.
TEST(Slices, OneMoreIsWishedWhereItTellsEnough) {
  const auto at = [](const ExplicitModulus& e, double z_m, std::optional<double> tolerance) {
    return wished_slice(e, {kBallX, 0, z_m, kFeltM}, tolerance);
  };
  const auto of = [](double deviation) {
    return stacked(grid(), {uniform(-0.005, 1e4, deviation), uniform(0.005, 4e4, deviation)}, {});
  };
  const ExplicitModulus known = of(0.1);
  for (const double z_m : {-0.0059, -0.005, -0.0041, 0.0055})
    EXPECT_FALSE(at(known, z_m, 0)) << "a slice reaches " << z_m;
  const auto between = at(known, 0.0004, 0.1), beyond = at(known, 0.0121, 0.1);
  ASSERT_TRUE(between && beyond);
  EXPECT_NEAR(between->z_m, 0.001, 1e-12);
  EXPECT_NEAR(beyond->z_m, 0.013, 1e-12);
  EXPECT_NEAR(between->half_width,
              1.96 * felt_log_deviation(known, {kBallX, 0, 0.0004, kFeltM}).value().all(), 1e-9);
  EXPECT_NEAR(beyond->half_width, 1.96 * felt_log_deviation(known, {kBallX, 0, 0.0121, kFeltM}).value().all(),
              1e-9);
  for (const double end_m : {-0.018, 0.018}) {  // the solid's own ends
    ASSERT_TRUE(at(known, end_m, 0.1));
    EXPECT_NEAR(at(known, end_m, 0.1)->z_m, std::copysign(0.017, end_m), 1e-12);
  }
  // By felt_between_variance, which is held by hand.
  const auto gains = [](const ExplicitModulus& e, double z_m, double deviation, double more_m) {
    const FeltElements felt(e.x_m, e.y_m, {kBallX, 0, z_m, kFeltM});
    return 1.96 * (std::hypot(deviation, std::sqrt(felt_between_variance(e, felt))) -
                   std::hypot(deviation, std::sqrt(felt_between_variance(e, felt, more_m))));
  };
  EXPECT_NEAR(gains(known, 0.0121, 0.1, 0.013), 0.571, 0.001);
  EXPECT_FALSE(at(known, 0.0121, 0.572)) << "less would be gained than is tolerated";
  EXPECT_TRUE(at(known, 0.0121, 0.570));
  EXPECT_FALSE(at(of(3), 0.0121, 0.1)) << "it would not be known better than what is there";
  EXPECT_TRUE(at(of(3), 0.0121, 0.05));
  const double gain = gains(of(0.3), 0.0062, 0.3, 0.007);
  EXPECT_GT(gain, 0.03);
  EXPECT_LT(gain, 0.1);
  EXPECT_TRUE(at(of(0.3), 0.0062, 0.03));
  EXPECT_FALSE(at(of(0.3), 0.0062, {})) << "half of what the slices state is good enough, up to a tenth";
  EXPECT_TRUE(at(of(0.3), 0.0121, {}));
  // Once it is there nothing is wished in its elements.
  const ExplicitModulus grown = with_slice(known, uniform(0.001, 1e4, 0.1), {}).modulus;
  for (const double z_m : {0.0001, 0.0004, 0.001, 0.0019}) EXPECT_FALSE(at(grown, z_m, 0)) << z_m;
  ASSERT_TRUE(at(grown, 0.0028, 0.05));
  EXPECT_NEAR(at(grown, 0.0028, 0.05)->z_m, 0.003, 1e-12);
}

// What the finger feels: hardly what is far from it, at its side or below.
TEST(Slices, TheirDeviationIsThatUnderTheFinger) {
  ModulusSlice slice = uniform(0, 1e4, 0.1);
  for (std::size_t n = 0; n < 240; ++n)
    if (n % 24 >= 16 || n / 24 >= 9) slice.log_deviation[n] = 1;
  const ExplicitModulus e = stacked(grid(), {slice}, {});
  const auto at = [&](double x_m, double depth_m) {
    return felt_log_deviation(e, {x_m, depth_m, 0, kFeltM}).value().measured;
  };
  EXPECT_GT(at(0.016, e.y_m.back() - 0.001), 0.5) << "felt from a row below";
  EXPECT_LT(at(0.016, 0), 0.2);
  EXPECT_GT(at(0.028, 0), 0.3);
  EXPECT_GT(at(0.047, 0), 0.95);
}

// Half of what is wrong here is wrong everywhere, or changes its sign with depth.
TEST(Slices, WhatIsWrongAlikeIsFeltAsAWholeTheRestLess) {
  const auto at = [](const ModulusSlice& slice, double radius_m = kFeltM) {
    return felt_log_deviation(stacked(grid(), {slice}, {}), {kBallX, 0, 0, radius_m}).value().measured;
  };
  ModulusSlice slice = uniform(0, 1e4, 0.5);
  EXPECT_NEAR(at(slice), 0.5, 1e-9) << "where nothing is known of that";
  slice.log_modes.assign(2 * 240, 0.3F);
  const double alike = 2 * 0.09, own = 0.25 - alike, left = left_of_local(kFeltM, choices::kLocalCorrelation);
  EXPECT_NEAR(at(slice), std::sqrt(alike + left * own), 1e-6);
  EXPECT_GT(at(slice, 0.001), at(slice)) << "a narrow contact feels more of it";
  for (std::size_t n = 24; n < 240; ++n) slice.log_modes[n] = -0.3F;
  EXPECT_LT(at(slice), std::sqrt(0.09 + 0.05 + left * own)) << "what it feels of a change cancels";
  slice.log_modes.assign(240, 0);
  EXPECT_NEAR(at(slice), std::sqrt(left) * 0.5, 1e-6);
  // Between slices, of which one says nothing.
  const ExplicitModulus both = stacked(grid(), {slice, uniform(0.004, 1e4, 0.5)}, {});
  ASSERT_EQ(both.log_modes.size(), 2u);
  EXPECT_TRUE(both.log_modes[1].empty());
  EXPECT_NEAR(felt_log_deviation(both, {kBallX, 0, 0.002, kFeltM}).value().measured,
              std::sqrt(0.125 * (1 + left / 2)), 1e-6);
}

// Summed by hand, every 10 um: what is wrong place by place is another thing 5 mm further across.
TEST(Slices, WhatIsKnownPlaceByPlaceIsFeltOfSeveralSlicesAtOnce) {
  const auto stated = [](const std::vector<double>& places, double z_m, double radius_m) {
    std::vector<ModulusSlice> slices;
    for (const double at_m : places)
      slices.push_back(uniform(at_m, 1e4, 0.2)), slices.back().log_modes.assign(240, 0);
    return felt_log_deviation(stacked(grid(), slices, {}), {kBallX, 0, z_m, radius_m}).value().measured;
  };
  const std::vector<double> places{-0.010, -0.005, 0, 0.005, 0.010};
  const double length_m = choices::kLocalCorrelation, none = stated({0}, 0, kFeltM);
  EXPECT_NEAR(none, 0.2 * std::sqrt(left_of_local(kFeltM, length_m)), 1e-9);
  for (const double radius_m : {0.001, kFeltM, 0.006})
    for (const double z_m : {0.0, 0.0013, 0.0025, 0.0125}) {
      const ExplicitModulus e = grid();
      const FeltElements felt(e.x_m, e.y_m, {kBallX, 0, z_m, radius_m});
      double variance = 0;
      felt.each([&](std::size_t n, double share) {
        std::vector<double> weight(places.size(), 0.0);
        constexpr double kStepM = 1e-5;
        for (double at_m = -1; at_m < 1; at_m += std::abs(at_m) < 0.05 ? kStepM : 0.01) {
          const double step_m = std::abs(at_m) < 0.05 ? kStepM : 0.01,
                       borne = felt.before(n / 24, at_m + step_m) - felt.before(n / 24, at_m),
                       along = std::clamp((at_m + step_m / 2 + 0.010) / 0.005, 0.0, 4.0);
          const auto first = std::min<std::size_t>(3, static_cast<std::size_t>(along));
          weight[first] += borne * (double(first) + 1 - along),
              weight[first + 1] += borne * (along - double(first));
        }
        for (std::size_t a = 0; a < places.size(); ++a)
          for (std::size_t b = 0; b < places.size(); ++b)
            variance += share * weight[a] * weight[b] * std::exp(-std::abs(places[a] - places[b]) / length_m);
      });
      const double single = stated({0}, 0, radius_m);
      EXPECT_NEAR(stated(places, z_m, radius_m) / single, std::sqrt(variance), 0.01)
          << radius_m << " " << z_m;
      EXPECT_LT(stated(places, z_m, radius_m), (z_m < 0.01 ? 0.97 : 1) * single);
    }
  EXPECT_NEAR(stated(places, 0.018, 0.001), stated({0}, 0, 0.001), 0.01)
      << "beyond the outermost one is felt";
}

TEST(Slices, DeviationsComeOneByOneAsTheyComeTogether) {
  const std::vector<ModulusSlice> all{uniform(-0.004, 1e4, 0), uniform(0.001, 2e4, 0.3),
                                      uniform(0.004, 3e4, 0)};
  ExplicitModulus grown = stacked(grid(), {all[2]}, {});
  EXPECT_TRUE(grown.log_deviation.empty());
  for (const std::size_t n : {0, 1}) grown = with_slice(grown, all[n], {}).modulus;
  EXPECT_EQ(grown.log_deviation, stacked(grid(), all, {}).log_deviation);
  EXPECT_EQ(grown.log_deviation[239], 0);
  EXPECT_EQ(grown.log_deviation[240], 0.3);
  grown = with_slice(grown, uniform(0.001, 2e4, 0), {}).modulus;
  EXPECT_EQ(grown.log_deviation, std::vector<double>(3 * 240)) << "another in its place, which states none";
}

// As a window 20 mm long sees them whose left border is 14 mm along the solid, in a slice that is there.
TEST(Slices, AreSeenFromTheImageOfOneAmongThem) {
  const auto e = std::make_shared<const ExplicitModulus>(stack({-0.005, 0.002, 0.006}));
  const std::vector<SliceBeside> beside = slices_beside(e, 0.014, 0.002);
  ASSERT_EQ(beside.size(), 2u);
  EXPECT_NEAR(beside[0].offset_m, -0.007, 1e-12);
  EXPECT_NEAR(beside[1].offset_m, 0.004, 1e-12);
  EXPECT_EQ(beside[0].modulus_pa(0.0095, 0.0095), 1e4) << "beside the ball";
  EXPECT_EQ(beside[1].modulus_pa(0.0095, 0.0095), 8e4);
  EXPECT_EQ(beside[1].modulus_pa(0.0015, 0.0095), 1e4);
  EXPECT_TRUE(std::isnan(beside[1].modulus_pa(0.0350, 0.0095))) << "beside the solid";
  EXPECT_TRUE(std::isnan(beside[1].modulus_pa(0.0095, 0.0310))) << "below it";
  ExplicitModulus many = grid();
  many.youngs_modulus_pa.assign(24 * 10 * 18, 1e4);
  for (int k = 1; k <= 100; ++k) many = with_slice(many, slice_at(0.0175 - 0.0001 * k), Limits{}).modulus;
  EXPECT_EQ(slices_beside(std::make_shared<const ExplicitModulus>(many), 0, 0.0125).size(), 32u)
      << "the nearest alone";
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
  for (const double deviation : {-0.1, 10.1, kNan})
    refused([&](ModulusSlice& s) { s.log_deviation.assign(240, 0), s.log_deviation[7] = deviation; },
            "slice.youngs_modulus_log_std[7]");
  refused([](ModulusSlice& s) { s.log_deviation.assign(239, 0); }, "slice.youngs_modulus_log_std");
  for (const float change : {0.2F, -0.2F, float(kNan), HUGE_VALF})
    refused(
        [&](ModulusSlice& s) {
          s.log_deviation.assign(240, 0.1), s.log_modes.assign(480, 0.01F), s.log_modes[247] = change;
        },
        "slice.youngs_modulus_log_modes[247]");
  for (const std::size_t size : {239, 241, 33 * 240})
    refused([&](ModulusSlice& s) { s.log_deviation.assign(240, 1), s.log_modes.assign(size, 0.01F); },
            "slice.youngs_modulus_log_modes");
  refused([](ModulusSlice& s) { s.log_modes.assign(240, 0); }, "slice.youngs_modulus_log_modes");
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
  few.max_solid_elements = 3 * 24 * 10;
  EXPECT_EQ(why([&] { stacked(grid(), slices_at({0, 1e-3, 2e-3, 3e-3}), few); }).rfind("slices: 4", 0), 0u);
  const ExplicitModulus full = stacked(grid(), slices_at({0, 1e-3, 2e-3}), few);
  EXPECT_EQ(why([&] { with_slice(full, slice_at(5e-3), few); }).rfind("slices: 4", 0), 0u);
  EXPECT_EQ(with_slice(full, slice_at(1e-3), few).modulus.slices(), 3u) << "in another's place";
  const auto plane = std::make_shared<Scene>("p", tissue(kWidthM, kDepthM), versions());
  EXPECT_THROW(plane->publish(slice_at(0)), Error);
}

TEST(Slices, AreChargedAndGivenBackAndWithoutRoomNothingChanges) {
  Limits limits;
  limits.host_memory_bytes = limits.device_memory_bytes = std::uint64_t{64} << 20;
  limits.client_memory_share = 1;
  const auto budget = std::make_shared<MemoryBudget>(limits);
  auto scene = scene_of(stack({0}), {budget, "", "s"});
  const std::uint64_t one = budget->held(Place::kHost);
  scene->publish(slice_at(0.004));
  EXPECT_EQ(budget->held(Place::kHost), one + (24 * 10 + 1 + 10) * sizeof(double))
      << "the one before is gone";
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
  EXPECT_EQ(again.explicit_modulus->hidden_log_variance, scene->snapshot()->modulus->hidden_log_variance);
  const auto restored = std::make_shared<Scene>(again, versions(), Limits{});
  TouchSession one(scene, {}, test_device()), other(restored, {}, test_device());
  const double force = one.solve({kBallX, 0.002, 0.0}).contact.force_n[1];
  EXPECT_NEAR(other.solve({kBallX, 0.002, 0.0}).contact.force_n[1], force, 2e-3 * std::abs(force));
  EXPECT_TRUE(again.explicit_modulus->log_deviation.empty());
  scene->publish(uniform(0.005, 1e4, 0.2));
  const EncodedScene doubtful = encoded(scene->record());
  EXPECT_EQ(decoded(
                doubtful.description, [&](const std::string&) { return doubtful.map; }, Limits{})
                .explicit_modulus->log_deviation,
            scene->snapshot()->modulus->log_deviation);
  ModulusSlice with_modes = uniform(0.007, 1e4, 0.2);
  with_modes.log_modes.assign(480, 0.1F);
  scene->publish(with_modes);
  const EncodedScene modes = encoded(scene->record());
  const auto read = [&](const std::string& description) {
    return decoded(
               description, [&](const std::string&) { return modes.map; }, Limits{})
        .explicit_modulus->log_modes;
  };
  EXPECT_EQ(read(modes.description), scene->snapshot()->modulus->log_modes);
  EXPECT_EQ(read(modes.description)[3].size(), 480u);
  std::string broken = kept.description;
  broken.replace(broken.find("\"slices\": 3"), 11, "\"slices\": 9");
  EXPECT_THROW(decoded(
                   broken, [&](const std::string&) { return kept.map; }, Limits{}),
               std::runtime_error);
}

}  // namespace
}  // namespace teletact::service
