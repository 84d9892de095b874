// teletact-bench law: how far interpolated contact laws (T7) are off from the model's own answers at poses
// that nobody chose, what they state, and what they cost; on random tissues.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <random>
#include <stdexcept>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/run_suite.h"
#include "bench/suites/law/cases.h"
#include "service/base/choices.h"
#include "service/contact/law_sampler.h"
#include "tests/support/allocation/allocation_count.h"

namespace teletact::bench {
namespace {

using service::LawSampler;

constexpr double kLightestM = 1e-4, kNearM = 0.010;
constexpr double kShare = 0.005, kTwiceShare = 0.01, kStrainedShare = 0.02, kFloorN = 1e-3;
constexpr double kStrained = 0.3;  // linear elasticity is far from the truth there

struct Arguments : SuiteOptions {
  std::uint64_t seed = 20261121;
};

struct Group {
  LawGroup group;
  const char* name;
  std::size_t tissues, poses;  // poses of each tissue
};
constexpr std::array kGroups{
    Group{LawGroup::kResolved, "resolved", 50, 2000}, Group{LawGroup::kChecker, "checkerboards", 20, 2000},
    Group{LawGroup::kStuck, "stuck", 20, 1000}, Group{LawGroup::kCoarse, "coarse", 20, 2000}};

struct Judged {
  std::string group, name;
  double within = 0, within_twice = 0;  // share of the poses that are answered
  double p99 = 0;                       // of the force's error, in 0.5 % + 1 mN
  double stated_over_p99 = 0;           // what is stated over the error: that of the worst hundredth
  double not_covered = 0;               // share of the poses that the model answers and the law does not
  std::size_t dropped_sweeps = 0;       // of 20, by answers that are right
  std::size_t samples = 0, columns = 0, solves = 0;
  double ms = 0, near_ms = 0;  // of the processor: the law, and what is near the finger
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Judged, group, name, within, within_twice, p99, stated_over_p99,
                                   not_covered, dropped_sweeps, samples, columns, solves, ms, near_ms)

// Of all poses of a group.
struct Pooled {
  std::string group;
  std::size_t poses = 0;
  double within = 0, within_twice = 0, stated_over_p99 = 0;
  double contradicting =
      0;  // share of the poses whose error is more than what is stated, which a client counts
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Pooled, group, poses, within, within_twice, stated_over_p99, contradicting)

struct Figures {
  std::uint64_t seed = 0;
  double evaluation_us = 0;
  std::size_t allocations = 0;  // of a million evaluations
  std::vector<Pooled> groups{};
  std::vector<Judged> laws{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, seed, evaluation_us, allocations, groups, laws)

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return kNan;
  const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

struct ContactError {
  double force_n, off_n, stated_n;
  ContactError(const LawValue& value, const service::ContactAnswer& exact)
      : force_n(std::hypot(exact.force_n[0], exact.force_n[1])),
        off_n(std::hypot(value.by_x_n + exact.force_n[0], value.by_d_n + exact.force_n[1])),
        stated_n(value.covered && !value.beyond ? value.error_n : HUGE_VAL) {}
};

// Poses of one law or of many.
struct Errors {
  std::vector<double> tolerances, over_stated;
  std::size_t within = 0, within_twice = 0, asked = 0, contradicting = 0;
  void add(const LawValue& value, const service::ContactAnswer& exact) {
    const auto [force_n, off_n, stated_n] = ContactError(value, exact);
    const bool strained = exact.largest_strain > kStrained;
    const double share = strained ? kStrainedShare : kShare, twice = strained ? kStrainedShare : kTwiceShare;
    within += off_n <= share * force_n + kFloorN;
    within_twice += off_n <= twice * force_n + kFloorN;
    tolerances.push_back(off_n / (kShare * force_n + kFloorN));
    over_stated.push_back(off_n / stated_n);
    contradicting += over_stated.back() > 1;
  }
  void add(const Errors& more) {
    tolerances.insert(tolerances.end(), more.tolerances.begin(), more.tolerances.end());
    over_stated.insert(over_stated.end(), more.over_stated.begin(), more.over_stated.end());
    within += more.within, within_twice += more.within_twice, asked += more.asked;
    contradicting += more.contradicting;
  }
  double share(std::size_t of) const {
    return double(of) / double(std::max<std::size_t>(1, tolerances.size()));
  }
  double stated_over_p99() const { return 1 / quantile(over_stated, 0.99); }
};

// Half of the poses are spread evenly over ln d, half over d.
Errors judge_poses(const LawCase& c, service::TouchedLayer& touched, const std::vector<LawColumn>& columns,
                   std::size_t poses, std::uint64_t seed) {
  std::mt19937_64 engine(seed);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * double(engine() >> 11) * 0x1p-53;
  };
  Errors errors;
  for (std::size_t k = 0; k < poses; ++k) {
    const double x = uniform(c.region.begin_x_m, c.region.end_x_m);
    const double d = k % 2 ? uniform(kLightestM, c.deepest_m)
                           : std::exp(uniform(std::log(kLightestM), std::log(c.deepest_m)));
    service::ContactAnswer exact;
    try {
      exact = touched.answer(c.tip, service::at_indentation(c.layer, {{x, 0, 0}}, d));
    } catch (const std::exception&) {  // the model's limits
      continue;
    }
    ++errors.asked;
    const LawValue value = evaluate(columns, x, d);
    if (value.covered && !value.beyond) errors.add(value, exact);
  }
  return errors;
}

// Whether every column near the finger is among them: the lattice has one a pitch further on at most.
bool reaches(const std::vector<LawColumn>& columns, double x_m) {
  const double all_m = kNearM - service::choices::kLawPitch;
  return !columns.empty() && columns.front().x_m <= x_m - all_m && columns.back().x_m >= x_m + all_m;
}

// A client drops a law that four answers in a row contradict: sweeps at one depth, an answer every
// millimetre, after which it would drop this one though every answer is right.
std::size_t dropped_sweeps(const LawCase& c, service::TouchedLayer& touched,
                           const std::vector<LawColumn>& columns) {
  constexpr double kStepM = 1.05e-3, kDeeper = 1.25;
  std::size_t dropped = 0;
  for (double d = kLightestM; d < c.deepest_m; d *= kDeeper) {
    int in_a_row = 0;
    for (double x = c.region.begin_x_m; x <= c.region.end_x_m && in_a_row < 4; x += kStepM) try {
        const ContactError error(evaluate(columns, x, d),
                                 touched.answer(c.tip, service::at_indentation(c.layer, {{x, 0, 0}}, d)));
        in_a_row = error.off_n > error.stated_n ? in_a_row + 1 : 0;
      } catch (const std::exception&) {  // the model's limits
        in_a_row = 0;
      }
    dropped += in_a_row == 4;
  }
  return dropped;
}

Judged judge(const LawCase& c, const Group& group, std::size_t poses, std::uint64_t seed, Errors& all,
             std::vector<LawColumn>* columns) {
  const auto touched = c.model->layer(c.layer, {}, {});
  const double middle_m = (c.region.begin_x_m + c.region.end_x_m) / 2;
  LawSampler sampler(touched, c.layer, c.tip, c.region.begin_x_m, c.region.end_x_m, middle_m);
  Judged judged{group.name, c.name};
  bool done = false;
  judged.near_ms = 1e3 * processor_seconds_of([&] {
                     while (!done && !reaches(sampler.columns(), middle_m)) done = sampler.advance({});
                   });
  judged.ms = judged.near_ms + 1e3 * processor_seconds_of([&] {
                                 if (!done) sampler.advance(LawSampler::Clock::time_point::max());
                               });
  const std::vector<LawColumn>& law = *columns = sampler.columns();
  for (const LawColumn& column : law) judged.samples += column.rows;
  judged.columns = law.size();
  judged.solves = sampler.solves();
  const Errors errors = judge_poses(c, *touched, law, poses, seed);
  judged.within = errors.share(errors.within), judged.within_twice = errors.share(errors.within_twice);
  judged.p99 = quantile(errors.tolerances, 0.99);
  judged.stated_over_p99 = errors.stated_over_p99();
  judged.not_covered = 1 - double(errors.tolerances.size()) / double(errors.asked);
  judged.dropped_sweeps = dropped_sweeps(c, *touched, law);
  all.add(errors);
  return judged;
}

// Of the law over places and depths in no order.
void time_evaluation(const LawCase& c, const std::vector<LawColumn>& columns, Figures& figures) {
  constexpr int kTimes = 1'000'000;
  double sum_n = 0;
  test::count_allocations(true);
  const double seconds = processor_seconds_of([&] {
    double share = 0.5;
    for (int k = 0; k < kTimes; ++k) {
      share = std::fmod(share + 0.618034, 1.0);
      const double x = c.region.begin_x_m + share * (c.region.end_x_m - c.region.begin_x_m);
      sum_n += evaluate(columns, x, c.deepest_m * (1 - share)).by_d_n;
    }
  });
  test::count_allocations(false);
  figures.allocations = test::counted_allocations();
  if (!std::isfinite(sum_n)) throw BenchError("the law has no numbers");
  figures.evaluation_us = std::max(figures.evaluation_us, 1e6 * seconds / kTimes);
}

template <class Member>
std::vector<double> of_group(const Figures& figures, const char* group, Member member) {
  std::vector<double> values;
  for (const Judged& law : figures.laws)
    if (law.group == group) values.push_back(double(law.*member));
  return values;
}

void promise(const Figures& f, Promises& promises) {
  const auto pooled = [&](const char* group) {
    return *std::find_if(f.groups.begin(), f.groups.end(), [&](const Pooled& p) { return p.group == group; });
  };
  const auto values = [&](const char* group, auto member) { return of_group(f, group, member); };
  const auto least = [](const std::vector<double>& v) { return *std::min_element(v.begin(), v.end()); };
  const auto most = [](const std::vector<double>& v) { return *std::max_element(v.begin(), v.end()); };
  promises.push_back({"poses_within_half_a_percent", pooled("resolved").within, 0.99, "1", false});
  promises.push_back({"poses_within_half_a_percent_worst_tissue", least(values("resolved", &Judged::within)),
                      0.98, "1", false});
  promises.push_back({"samples_median_tissue", median_of(values("resolved", &Judged::samples)), 80});
  promises.push_back({"sampling_median_tissue", median_of(values("resolved", &Judged::ms)), 3, "ms"});
  promises.push_back(
      {"near_columns_median_tissue", median_of(values("resolved", &Judged::near_ms)), 0.5, "ms"});
  promises.push_back(
      {"checkerboards_within_one_percent", pooled("checkerboards").within_twice, 0.95, "1", false});
  promises.push_back(
      {"checkerboards_samples_median", median_of(values("checkerboards", &Judged::samples)), 300});
  promises.push_back(
      {"checkerboards_sampling_median", median_of(values("checkerboards", &Judged::ms)), 15, "ms"});
  promises.push_back({"stuck_within_one_percent", pooled("stuck").within_twice, 0.95, "1", false});
  promises.push_back({"stuck_samples_median", median_of(values("stuck", &Judged::samples)), 130});
  promises.push_back({"stuck_sampling_median", median_of(values("stuck", &Judged::ms)), 16, "ms"});
  for (const Pooled& group : f.groups) {
    const std::string name = snake_case(group.group) + "_stated_over_the_worst_hundredth";
    promises.push_back({name + "_least", group.stated_over_p99, 1, "", false});
    promises.push_back({name + "_most", group.stated_over_p99, 2, ""});
  }
  for (const Pooled& group : f.groups) {
    const std::vector<double> dropped = values(group.group.c_str(), &Judged::dropped_sweeps);
    promises.push_back({snake_case(group.group) + "_sweeps_that_drop_a_law",
                        std::accumulate(dropped.begin(), dropped.end(), 0.0), 0});
    promises.push_back({snake_case(group.group) + "_not_covered_worst_tissue",
                        most(values(group.group.c_str(), &Judged::not_covered)), 0});
  }
  promises.push_back({"evaluation", f.evaluation_us, 0.2, "us"});
  promises.push_back({"allocations", double(f.allocations), 0});
}

Figures measure(const Arguments& arguments, Promises& promises) {
  Figures figures{arguments.seed};
  std::printf(
      "%-60s within %%  1 %%    p99  stated/p99  open %%  dropped samples columns solves    ms  near ms\n",
      "law");
  for (const Group& group : kGroups) {
    Errors all;
    std::vector<LawColumn> columns;
    for (std::size_t k = 0; k < (arguments.quick ? group.tissues / 5 : group.tissues); ++k) {
      const LawCase c = make_law_case(group.group, arguments.seed, k);
      const Judged& j = figures.laws.emplace_back(judge(
          c, group, arguments.quick ? group.poses / 4 : group.poses, arguments.seed + k, all, &columns));
      std::printf("%-60s %7.1f %6.1f %6.2f %8.2f %9.1f %7zu %8zu %6zu %6zu %7.2f %7.2f\n", j.name.c_str(),
                  100 * j.within, 100 * j.within_twice, j.p99, j.stated_over_p99, 100 * j.not_covered,
                  j.dropped_sweeps, j.samples, j.columns, j.solves, j.ms, j.near_ms);
      if (k == 0) time_evaluation(c, columns, figures);
    }
    figures.groups.push_back({group.name, all.tolerances.size(), all.share(all.within),
                              all.share(all.within_twice), all.stated_over_p99(),
                              all.share(all.contradicting)});
    const Pooled& p = figures.groups.back();
    std::printf("%-60s %7.2f %6.2f        %8.2f; %.3f %% contradict it\n", group.name, 100 * p.within,
                100 * p.within_twice, p.stated_over_p99, 100 * p.contradicting);
  }
  promise(figures, promises);
  return figures;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  std::vector<Curve> by_samples, by_time;
  for (const Group& group : kGroups) {
    Curve samples{.title = group.name, .line = false}, time{.title = group.name, .line = false};
    for (const Judged& law : figures.laws)
      if (law.group == group.name) samples.add(double(law.samples), law.p99), time.add(law.ms, law.p99);
    by_samples.push_back(std::move(samples)), by_time.push_back(std::move(time));
  }
  const std::string scales = "set logscale xy\nset key bottom left\n";
  const std::string error = "error of the force, 99 % (0.5 % + 1 mN)";
  plot(folder / "law_samples.png",
       script_of(by_samples, scales + axes("Contact laws of 60 mm", "samples", error)));
  plot(folder / "law_time.png",
       script_of(by_time, scales + axes("Contact laws of 60 mm", "processor time (ms)", error)));
}

}  // namespace

void add_law_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = add_suite(app, "law", "interpolated contact laws: error, what is stated, cost",
                                arguments, met, measure, draw);
  command.add_option("--seed", arguments->seed, "of the tissues and poses");
}

}  // namespace teletact::bench
