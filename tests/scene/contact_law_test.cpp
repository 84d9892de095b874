// Contact laws of windows: how far what is interpolated is off from the model's own answers, at poses that
// nobody chose.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "service/base/limits.h"
#include "service/base/memory.h"
#include "service/contact/contact_laws.h"
#include "tests/scene/half_space.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

constexpr double kWindowM = 0.06, kDepthM = 0.04;

TrueModulus checkerboard(double contrast, double size_m) {
  return [=](double x, double y) { return 10e3 * ((int(x / size_m) + int(y / size_m)) % 2 ? contrast : 1); };
}

struct Case {
  std::string name;
  TrueModulus truth;
  Fingertip tip;
  double layer_m = 0, deepest_m = 0.005;
};

struct Measured {
  double within = 0, within_twice = 0;  // share of poses within 0.5 % + 1 mN, and 1 % + 1 mN
  double p99 = 0;                       // of the error, in units of 0.5 % + 1 mN
  double stated = 0;                    // what is stated over the error: that of the worst hundredth
  std::size_t samples = 0;
};

Measured measure(const Case& c) {
  Scene scene("s", tissue(3 * kWindowM, kDepthM), versions());
  for (int k = 0; k < 3; ++k) scene.publish(window_of(c.truth, kWindowM * k, kWindowM, kDepthM));
  while (scene.refresh_stale_window()) {
  }
  const auto window = scene.snapshot()->windows[1];
  const Layer layer = scene.layer_near(c.layer_m);
  const auto touched = window->model->layer(layer, {}, {});
  const Region& region = window->region;
  const auto law = window->model->laws().get(c.tip, layer, {}, touched, region, {0.08, 0, 0}, {});
  EXPECT_TRUE(law) << c.name;
  if (!law) return {};
  std::mt19937 random(11);
  std::uniform_real_distribution<double> x_m(region.begin_x_m, region.end_x_m);
  std::uniform_real_distribution<double> log_d(std::log(1e-4), std::log(c.deepest_m));
  std::vector<double> errors, stated;
  Measured measured;
  for (int k = 0; k < 2000; ++k) {
    const double x = x_m(random), d = std::exp(log_d(random));
    const ContactAnswer exact = touched->answer(c.tip, at_indentation(layer, {{x, 0, 0}}, d));
    const LawValue value = evaluate(law->columns, x, d);
    EXPECT_TRUE(value.covered && !value.beyond) << c.name << " at " << x << ", " << d;
    const double off_n = std::hypot(value.by_x_n + exact.force_n[0], value.by_d_n + exact.force_n[1]);
    const double force_n = std::hypot(exact.force_n[0], exact.force_n[1]);
    errors.push_back(off_n / (0.005 * force_n + 1e-3));
    stated.push_back(value.error_n / off_n);
    measured.within += errors.back() <= 1;
    measured.within_twice += off_n <= 0.01 * force_n + 1e-3;
  }
  const double poses = double(errors.size());
  measured.within /= poses, measured.within_twice /= poses;
  const auto quantile = [](std::vector<double> values, double share) {
    const auto at = values.begin() + std::ptrdiff_t(share * double(values.size()));
    std::nth_element(values.begin(), at, values.end());
    return *at;
  };
  measured.p99 = quantile(errors, 0.99);
  measured.stated = quantile(stated, 0.01);
  for (const LawColumn& column : law->columns) measured.samples += column.rows;
  std::printf("%-34s within %5.1f %%, 1 %%: %5.1f %%; p99 %.2f, stated %.2f times that; %zu samples\n",
              c.name.c_str(), 100 * measured.within, 100 * measured.within_twice, measured.p99,
              measured.stated, measured.samples);
  return measured;
}

const Fingertip kRadius4{.radius_m = 0.004}, kRadius14{.radius_m = 0.014};
const Fingertip kPunch{.shape = FingertipShape::kFlatPunch, .radius_m = 0.004};
const Fingertip kGaussian{.shape = FingertipShape::kNode, .footprint_m = 0.001};

TEST(ContactLawOfAWindow, IsWithinHalfAPercentUnderResolvedTips) {
  const Case cases[] = {{"homogeneous, R 8", homogeneous(10e3), {}},
                        {"contrast 5, R 8", inclusion(10e3, 5, 0.09, 0.010, 0.005), {}},
                        {"contrast 30, R 8", inclusion(10e3, 30, 0.09, 0.008, 0.005), {}},
                        {"contrast 10 at 3 to 9 mm, R 8", inclusion(10e3, 10, 0.088, 0.006, 0.003), {}},
                        {"contrast 5 across the border, R 8", inclusion(10e3, 5, 0.06, 0.010, 0.005), {}},
                        {"contrast 30, R 4", inclusion(10e3, 30, 0.09, 0.008, 0.005), kRadius4},
                        {"contrast 30, R 14", inclusion(10e3, 30, 0.09, 0.008, 0.005), kRadius14},
                        {"contrast 30, punch", inclusion(10e3, 30, 0.09, 0.008, 0.005), kPunch},
                        {"contrast 30, Gaussian node", inclusion(10e3, 30, 0.09, 0.008, 0.005), kGaussian}};
  std::vector<std::size_t> samples;
  double all = 0, stated = 0;
  for (const Case& c : cases) {
    const Measured measured = measure(c);
    EXPECT_GE(measured.within, 0.98) << c.name;
    EXPECT_GE(measured.stated, 1) << c.name;
    stated += measured.stated / std::size(cases);
    all += measured.within / std::size(cases);
    samples.push_back(measured.samples);
  }
  EXPECT_GE(all, 0.99);
  EXPECT_LE(stated, 2);
  std::nth_element(samples.begin(), samples.begin() + std::ssize(samples) / 2, samples.end());
  EXPECT_LE(samples[samples.size() / 2], 80u);
}

TEST(ContactLawOfAWindow, IsWithinAPercentWhereItIsHard) {
  const Case checkers{"checkerboard of 10, R 8", checkerboard(10, 0.005), {}};
  const Measured hard = measure(checkers);
  EXPECT_GE(hard.within_twice, 0.95);
  EXPECT_LE(hard.samples, 300u);
  const Case stuck{"contrast 5, stuck, R 8",
                   inclusion(10e3, 5, 0.09, 0.010, 0.005),
                   {.friction = Friction::kStuck},
                   0,
                   0.004};
  const Measured tied = measure(stuck);
  EXPECT_GE(tied.within_twice, 0.95);
  EXPECT_LE(tied.samples, 130u);
  const Case inside{"contrast 30, R 8, 5 mm deep", inclusion(10e3, 30, 0.09, 0.015, 0.005), {}, 0.005};
  EXPECT_GE(measure(inside).within_twice, 0.97);
}

// A tip too small for the mesh has ripples that no law of few samples holds: it is said how large they are.
TEST(ContactLawOfAWindow, SaysWhatATipTooSmallForTheMeshCosts) {
  const Case small{"contrast 5, R 1.3", inclusion(10e3, 5, 0.09, 0.010, 0.005), {.radius_m = 0.0013}};
  const Measured measured = measure(small);
  EXPECT_LT(measured.within, 0.95);
  EXPECT_GE(measured.stated, 1);
  EXPECT_LE(measured.stated, 2);
}

TEST(ContactLaws, AreSampledOnceBesideTouchAndSharedByTipAndLayer) {
  Scene scene("s", tissue(0.1, 0.04), versions());
  scene.publish(window_of(homogeneous(10e3), 0.02, kWindowM, kDepthM));
  const auto window = scene.snapshot()->windows[0];
  const Layer layer = scene.layer_near(0);
  const auto touched = window->model->layer(layer, {}, {});
  std::deque<std::function<void()>> jobs;
  const TouchWork work = [&](const std::string&, std::function<void()> job) {
    jobs.push_back(std::move(job));
  };
  const auto ask = [&](const Fingertip& tip) {
    return window->model->laws().get(tip, layer, {}, touched, window->region, {0.05, 0, 0}, work);
  };
  EXPECT_FALSE(ask({}));
  EXPECT_FALSE(ask({}));
  ASSERT_EQ(jobs.size(), 1u);
  for (std::size_t k = 0; k < jobs.size(); ++k) jobs[k]();  // each step asks for the next
  jobs.resize(1);
  const auto law = ask({});
  ASSERT_TRUE(law);
  EXPECT_EQ(ask({}), law);
  EXPECT_EQ(jobs.size(), 1u);
  // Others take the places of those that were asked for least recently.
  for (std::size_t k = 1; k < ContactLaws::kMax; ++k) ask({.radius_m = 0.008 + 1e-4 * double(k)});
  EXPECT_EQ(ask({}), law);
  ask({.radius_m = 0.02});
  EXPECT_EQ(ask({}), law);
  EXPECT_EQ(jobs.size(), ContactLaws::kMax + 1);
  jobs[1]();  // of one whose place was taken: nothing is left to do
  EXPECT_FALSE(ask({.radius_m = 0.008 + 1e-4}));
  EXPECT_EQ(jobs.size(), ContactLaws::kMax + 2);
}

TEST(ContactLaws, OfEachLayerAreItsOwnAndHeldInTheTissuesName) {
  Limits limits;
  limits.host_memory_bytes = 1 << 30, limits.client_memory_share = 1;
  const auto budget = std::make_shared<MemoryBudget>(limits);
  const auto held = [&] {
    for (const MemoryUse& use : budget->uses())
      if (use.kind == "contact laws") return use.bytes;
    return std::uint64_t{0};
  };
  {
    Scene scene("s", tissue(0.1, 0.04), versions(), {}, {budget, "anna", "s"});
    scene.publish(window_of(homogeneous(10e3), 0.02, kWindowM, kDepthM));
    const auto window = scene.snapshot()->windows[0];
    std::size_t columns = 0;
    std::shared_ptr<const ContactLaw> of_last;
    for (const double depth_m : {0.0, 0.01}) {
      const Layer layer = scene.layer_near(depth_m);
      const auto law = window->model->laws().get({}, layer, {}, window->model->layer(layer, {}, {}),
                                                 window->region, {0.05, 0, 0}, {});
      ASSERT_TRUE(law);
      EXPECT_NE(law, of_last);
      columns += law->columns.size();
      EXPECT_EQ(held(), columns * sizeof(LawColumn));
      of_last = law;
    }
  }
  EXPECT_EQ(held(), 0U);
}

TEST(ContactLaws, AModelThatIsGoneSamplesNothing) {
  auto scene = std::make_unique<Scene>("s", tissue(0.1, 0.04), versions());
  scene->publish(window_of(homogeneous(10e3), 0.02, kWindowM, kDepthM));
  auto window = scene->snapshot()->windows[0];
  std::function<void()> posted;
  const TouchWork work = [&](const std::string&, std::function<void()> job) { posted = std::move(job); };
  const Layer layer = scene->layer_near(0);
  window->model->laws().get({}, layer, {}, window->model->layer(layer, {}, {}), Region{0.03, 0.05},
                            {0.04, 0, 0}, work);
  const std::weak_ptr<const TouchModel> model = window->model;
  scene.reset(), window.reset();
  EXPECT_TRUE(model.expired());  // the job holds none
  const auto job = std::exchange(posted, nullptr);
  job();
  EXPECT_FALSE(posted);
}

TEST(ContactLaws, ATiltedLayerHasNone) {
  const HalfSpace half_space(10e3, 0.49, {});
  const auto touched = half_space.layer(tilted_surface(), {}, {});
  EXPECT_FALSE(half_space.laws().get({}, tilted_surface(), {}, touched, Region{0, 0.1}, {0.05, 0, 0}, {}));
}

}  // namespace
}  // namespace teletact::service
