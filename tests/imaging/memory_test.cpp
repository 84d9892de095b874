// Memory of the imaging plane: what a pair needs is asked for before it is taken, models of the modulus give
// way to others in the order of last use, and what is refused leaves nothing.
#include <gtest/gtest.h>

#include <memory>
#include <stdexcept>

#include "service/base/limits.h"
#include "service/base/memory.h"
#include "service/imaging/engines.h"
#include "service/imaging/estimate.h"
#include "service/imaging/modulus/strip_model.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"

namespace teletact::service {
namespace {

constexpr std::uint64_t kPlenty = std::uint64_t{1} << 40;
constexpr std::size_t kSamples = 520, kLines = 42;  // 10 x 10 mm

std::shared_ptr<MemoryBudget> budget_of(std::uint64_t host, std::uint64_t device) {
  Limits limits;
  limits.host_memory_bytes = host, limits.device_memory_bytes = device, limits.client_memory_share = 1;
  return std::make_shared<MemoryBudget>(limits);
}

std::uint64_t held(const MemoryBudget& budget, const std::string& kind) {
  std::uint64_t bytes = 0;
  for (const MemoryUse& use : budget.uses())
    if (use.kind == kind) bytes += use.bytes;
  return bytes;
}

struct Pair {
  RfFrame pre, post;
};

const Pair& pair() {
  static const Pair made = [] {
    SpeckleOptions options;
    options.samples = kSamples, options.lines = kLines;
    const Speckle speckle(options);
    return Pair{speckle.frame(
                    [](double, double) {
                      return std::pair{0.0, 0.0};
                    },
                    1),
                speckle.frame(
                    [](double, double y) {
                      return std::pair{0.0, -0.012 * y};
                    },
                    2)};
  }();
  return made;
}

TissueExtent slab() {
  return {kLines * speckle_geometry().line_pitch_m, 0.010, 0, 0.3};
}

Estimate estimate(Elastography& engine) {
  return engine.estimate(pair().pre, pair().post, {speckle_geometry(), {}, slab()});
}

TEST(ImagingMemory, RequestBeyondTheBudgetIsRefusedWhole) {
  const auto plenty = budget_of(kPlenty, kPlenty);
  std::uint64_t needed = 0;
  {
    Elastography engine(imaging_device());
    engine.charge_to({plenty, "anna", ""});
    estimate(engine);
    needed = plenty->held(Place::kDevice);
    EXPECT_GT(needed, kSamples * kLines * sizeof(float));
  }
  EXPECT_EQ(plenty->held(Place::kDevice), 0U);
  EXPECT_EQ(plenty->held(Place::kHost), 0U);
  const auto tight = budget_of(kPlenty, needed / 2);
  Elastography engine(imaging_device());
  engine.charge_to({tight, "anna", ""});
  const std::uint64_t before = imaging_device()->held_bytes();
  try {
    estimate(engine);
    FAIL() << "was not refused";
  } catch (const MemoryRefused& refused) {
    // As a whole: the sum is named, not the array that happened to come last.
    EXPECT_NE(std::string(refused.what()).find(" 0 of "), std::string::npos) << refused.what();
  }
  EXPECT_EQ(imaging_device()->held_bytes(), before);
  EXPECT_EQ(tight->held(Place::kDevice), 0U);
  EXPECT_EQ(held(*tight, "estimates"), 0U);
  engine.charge_to({plenty, "anna", ""});
  EXPECT_NO_THROW(estimate(engine)) << "less, or elsewhere, is served after a refusal";
}

// How tissues answer a push is kept for the pairs to come, in the name of who sent this one.
TEST(ImagingMemory, WhatASolidKeepsIsHeldUntilAnotherComes) {
  const auto budget = budget_of(kPlenty, kPlenty);
  Elastography engine(imaging_device());
  engine.charge_to({budget, "anna", ""});
  TissueExtent solid = slab();
  solid.plane = Plane::kSolid, solid.probe_elevation_m = 0.005;
  const auto kept = [&] {
    engine.estimate(pair().pre, pair().post, {speckle_geometry(), {}, solid});
    return held(*budget, "tissues");
  };
  const std::uint64_t first = kept();
  EXPECT_GT(first, 20 * sizeof(double)) << "of some twenty tissues";
  EXPECT_EQ(kept(), first) << "the same pair asks for nothing more";
  engine.charge_to({budget, "berta", ""});
  EXPECT_EQ(held(*budget, "tissues"), 0U);
}

// What cannot be searched at all is refused before anything is taken for it, from the sizes alone; nobody's
// idle engine has given way for it.
TEST(ImagingMemory, WhatWouldNotFitIsRefusedBeforeAnythingIsTaken) {
  const auto budget = budget_of(kPlenty, kPlenty);
  Elastography engine(imaging_device());
  engine.charge_to({budget, "anna", ""});
  estimate(engine);
  const std::uint64_t host = budget->held(Place::kHost), device = budget->held(Place::kDevice);
  constexpr std::size_t kMaxSamples = 16384, kMaxLines = 2048;
  DisplacementOptions options;
  EXPECT_THROW(DisplacementEstimator::require_fits({kMaxSamples, kMaxLines, {}}, speckle_geometry(), options),
               std::invalid_argument);
  const RfFrame large{kMaxSamples, kMaxLines, std::vector<float>(kMaxSamples * kMaxLines)};
  EXPECT_THROW(engine.estimate(large, large, {speckle_geometry(), {}, slab()}), std::invalid_argument);
  EXPECT_EQ(budget->held(Place::kHost), host);
  EXPECT_EQ(budget->held(Place::kDevice), device) << "what is kept for the next pair is still kept";
  options.max_strain = 0.02;
  EXPECT_NO_THROW(
      DisplacementEstimator::require_fits({kMaxSamples, kMaxLines, {}}, speckle_geometry(), options));
}

TEST(ImagingMemory, IdleEngineMakesRoomForAnother) {
  const auto budget = budget_of(kPlenty, std::uint64_t{1} << 30);
  const MemoryAccount anna{budget, "anna", ""}, berta{budget, "berta", ""};
  Engines engines(imaging_device());
  const auto by_engine = [&](const MemoryAccount& account) {
    const auto engine = engines.borrow(account.client);
    engine->charge_to(account);
    return estimate(*engine).axial_strain;
  };
  const Field first = by_engine(anna);
  EXPECT_GT(budget->held(Place::kDevice, "anna"), 0U) << "kept for the next pair";
  {
    const Charge all = berta.charge(Place::kDevice, "arrays", std::uint64_t{1} << 30);
    EXPECT_EQ(budget->held(Place::kDevice, "anna"), 0U);
    EXPECT_THROW(by_engine(anna), MemoryRefused);
  }
  EXPECT_EQ(by_engine(anna).size(), first.size());
  // Another client's pair takes over an idle engine, and its bytes.
  const auto a = engines.borrow("anna");
  a->charge_to(berta);
  EXPECT_EQ(budget->held(Place::kDevice, "anna"), 0U);
}

TEST(ImagingMemory, AnEstimateHoldsItsMapsUntilItIsTaken) {
  const auto budget = budget_of(kPlenty, kPlenty);
  Elastography engine(imaging_device());
  engine.charge_to({budget, "anna", ""});
  {
    const Estimate kept = estimate(engine);
    EXPECT_GE(held(*budget, "estimates"), 13 * sizeof(float) * kept.grid.size());
    EXPECT_EQ(held(*budget, "estimating"), 0U) << "what was needed meanwhile is gone";
    EXPECT_GT(held(*budget, "strips"), 0U);
  }
  EXPECT_EQ(held(*budget, "estimates"), 0U);
  const auto none = budget_of(10000, kPlenty);
  engine.charge_to({none, "berta", ""});
  EXPECT_THROW(estimate(engine), MemoryRefused);
  EXPECT_EQ(none->held(Place::kHost), 0U);
}

TEST(ImagingMemory, OldestModelLeavesFirst) {
  const auto at = [](double depth_m) { return TissueExtent{0.060, depth_m, 0.010, 0.49}; };
  std::uint64_t one = 0;
  {
    const auto plenty = budget_of(kPlenty, 0);
    StripCache cache;
    cache.charge_to({plenty, "anna", ""});
    cache.get(at(0.030), 0.040);
    one = plenty->held(Place::kHost);
    EXPECT_GT(one, std::uint64_t{1} << 20);
  }
  const auto budget = budget_of(4 * one, 0);
  StripCache cache;
  cache.charge_to({budget, "anna", ""});
  const auto held_by_us = cache.get(at(0.030), 0.040);
  const std::weak_ptr<StripCache::Entry> second = cache.get(at(0.031), 0.040);
  for (int k = 2; k < 10; ++k) {
    EXPECT_NO_THROW(cache.get(at(0.030 + 1e-3 * k / 10), 0.040));
    EXPECT_LE(budget->held(Place::kHost), 4 * one);
  }
  EXPECT_TRUE(second.expired()) << "what was used longest ago is gone";
  EXPECT_EQ(cache.get(at(0.030), 0.040), held_by_us) << "what somebody uses is not";
}

}  // namespace
}  // namespace teletact::service
