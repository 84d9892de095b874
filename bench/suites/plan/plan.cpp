// teletact-bench plan: models of a touch of solid tissue, speed against accuracy, each against a truth (T9).
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <utility>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/rigid_contact.h"
#include "bench/run_suite.h"
#include "bench/suites/plan/cases.h"
#include "bench/suites/plan/figures.h"
#include "bench/suites/plan/models.h"
#include "bench/suites/plan/scenes.h"
#include "bench/suites/plan/summary.h"
#include "bench/suites/plan/truth.h"

namespace teletact::bench {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PlanPose, x_m, z_m, indentation_m)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PlanLump, centre_m, radius_m, contrast)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(HardCase, name, true_n, felt_n, error, stated, by, shares_error,
                                   shares_stated, said)

namespace plan {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Answer, model, force_n, ms, error, beside, stated, budget, by)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Pair, scene, kind, poisson_ratio, texture, lumps, pose, coarse_n, fine_n,
                                   truth_n, finer_n, layer_n, answers)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Summary, kind, model, pairs, ms, p50, p95, most, beside_p50, beside_p95,
                                   beside_most, covered, budget_covers, budget_over_error, suffices, cheapest)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Model, model, ms, p50, p95, most, suffices, cheapest, budget_covers,
                                   budget_over_error)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Class, pairs_of, pairs, scenes, m1_covers, m3_covers, planned_covers)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Learning, nodes, fields_ms, slice_ms, tip_ms)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Planned, tolerance, missed, said, cheap, ms, finest_ms, by_m1, by_m3)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, seed, m3_ready_ms, m4_ready_ms, changes_on_a_border, learning,
                                   models, summaries, classes, planned, cases, failures, pairs)

namespace {

struct Arguments : SuiteOptions {
  std::size_t pairs = 1000, finer = 6;
  std::uint64_t seed = 1;
  bool offered = false;
  double minutes = 1e6;
  std::string pairs_of;  // --json of an earlier run
};

Pair measure_pair(PlanModels& models, RigidContact& coarse, RigidContact& fine, const PlanScene& scene,
                  const PlanPose& pose) {
  Pair pair{.kind = scene.kind,
            .poisson_ratio = scene.poisson_ratio,
            .texture = scene.texture,
            .lumps = scene.lumps,
            .pose = pose};
  const TrueForce truth = true_force(coarse, fine, pose);
  pair.coarse_n = truth.coarse_n, pair.fine_n = truth.fine_n, pair.truth_n = truth.force_n();
  pair.layer_n = models.layer_n(pose);
  for (const PlanAnswer& a : models.at(pose))
    pair.answers.push_back({a.model, a.force_n, a.ms, a.force_n / pair.truth_n - 1,
                            a.force_n / a.converged_n - 1, a.stated, a.budget, a.by});
  return pair;
}

void print(const HardCase& c) {
  std::printf("plan: %-52s %8.4f N: %s off by %5.1f %%, stated %5.1f; shares %5.1f, stated %5.1f%s%s\n",
              c.name.c_str(), c.true_n, c.by.c_str(), 100 * c.error, 100 * c.stated, 100 * c.shares_error,
              100 * c.shares_stated, c.said.empty() ? "" : "; said: ", c.said.c_str());
}

void promise(const Figures& f, Promises& promises) {
  if (!f.pairs.empty()) {
    std::vector<double> layer, finer;
    double stated = 0, budget = 0;  // shares of the pairs that M3 covers so
    for (const Pair& pair : f.pairs) {
      if (pair.kind == "homogeneous") layer.push_back(std::abs(pair.truth_n / pair.layer_n - 1));
      if (pair.finer_n > 0) finer.push_back(std::abs(pair.truth_n / pair.finer_n - 1));
      for (const Answer& a : pair.answers)
        if (a.model == "M3") stated += std::abs(a.beside) <= a.stated, budget += within_budget(a);
    }
    promises.push_back({"truth_off_the_exact_layer", quantiles(layer).max, 0.01});
    if (!finer.empty()) promises.push_back({"truth_off_a_finer_one", quantiles(finer).max, 0.02});
    promises.push_back({"converged_stated_covers", stated / double(f.pairs.size()), 0.95, "1", false});
    promises.push_back({"converged_within_its_budget", budget / double(f.pairs.size()), 0.95, "1", false});
    // Of fewer pairs one class of tissue decides.
    constexpr std::size_t kFew = 100, kMany = 400, kManyScenes = 100;
    double m1 = 1, m3 = 1, planned = 1;
    for (const Class& c : f.classes)
      if (&c == f.classes.data() || (c.pairs >= kMany && c.scenes >= kManyScenes))
        m1 = std::min(m1, c.m1_covers), m3 = std::min(m3, c.m3_covers),
        planned = std::min(planned, c.planned_covers);
    promises.push_back({"shares_budget_covers_in_the_worst_class", m1, 0.92, "1", false});
    promises.push_back({"nodes_budget_covers_in_the_worst_class", m3, 0.92, "1", false});
    promises.push_back({"planned_budget_covers_in_the_worst_class", planned, 0.92, "1", false});
    for (const Model& m : f.models) {
      const char* name = m.model == "M1" ? "shares" : m.model == "M3" ? "nodes" : nullptr;
      if (name && f.pairs.size() >= kFew)
        promises.push_back({fmt::format("{}_budget_over_error_median", name), m.budget_over_error, 5});
    }
    for (const Planned& p : f.planned) {
      promises.push_back({fmt::format("planned_misses_{:.0f}_percent", 100 * p.tolerance), p.missed, 0.05});
      if (f.pairs.size() < kFew) continue;
      promises.push_back(
          {fmt::format("planned_is_cheap_{:.0f}_percent", 100 * p.tolerance), p.cheap, 0.75, "1", false});
    }
    promises.push_back({"pairs_without_a_truth", double(f.failures.size()) / double(f.pairs.size()), 0.01});
    if (f.pairs.size() >= kFew) {
      promises.push_back({"fields_of_a_factor", f.learning.front().fields_ms, 15, "ms"});
      promises.push_back({"shares_of_a_slice", f.learning.front().slice_ms, 0.5, "ms"});
    }
  }
  promises.push_back(
      {"hard_cases_missed_without_a_word", double(std::ranges::count_if(f.cases, &HardCase::missed)), 0});
  promises.push_back({"changes_of_model_on_a_border", double(f.changes_on_a_border), 0});
}

// What scenes take to be made ready, and what is learned of them: medians.
class Readiness {
 public:
  void add(const PlanScene& scene, const PlanModels::Ready& made) {
    m3_.push_back(made.m3_ms);
    if (made.m4_ms > 0) m4_.push_back(made.m4_ms);
    if (scene.kind == "thin") return;  // a quarter of the nodes
    add(made.coarse, scene.modulus_pa.size());
    if (made.fine.fields_ms > 0) add(made.fine, 8 * scene.modulus_pa.size());
  }
  void put(Figures& f) const {
    f.m3_ready_ms = median_of(m3_), f.m4_ready_ms = median_of(m4_);
    f.learning.clear();
    for (const auto& [nodes, learned] : learned_) {
      const auto median = [&all = learned](double PlanModels::Learned::*of) {
        std::vector<double> values;
        for (const PlanModels::Learned& l : all) values.push_back(l.*of);
        return median_of(values);
      };
      f.learning.push_back({nodes, median(&PlanModels::Learned::fields_ms),
                            median(&PlanModels::Learned::slice_ms), median(&PlanModels::Learned::tip_ms)});
    }
  }

 private:
  void add(const PlanModels::Learned& learned, std::size_t nodes) { learned_[nodes].push_back(learned); }
  std::vector<double> m3_, m4_;
  std::map<std::size_t, std::vector<PlanModels::Learned>> learned_;  // by nodes
};

void measure_pairs(const std::shared_ptr<service::Device>& device, const Arguments& arguments, Figures& f) {
  constexpr std::size_t kFineEvery = 10;  // scenes
  const std::size_t wanted = arguments.quick ? 12 : arguments.pairs, poses = arguments.quick ? 2 : 5;
  PlanModels models(device, arguments.offered);
  std::vector<std::string> checked;
  Readiness ready;
  const auto begin = Clock::now();
  for (std::size_t n = 0; n * poses < wanted && seconds_since(begin) < 60 * arguments.minutes; ++n) {
    const PlanScene scene =
        plan_scene(arguments.seed, n, std::min(poses, wanted - n * poses), arguments.quick);
    ready.add(scene, models.enter(scene, n % kFineEvery == 0));
    RigidContact coarse(device->queue(), scene.tissue(1)), fine(device->queue(), scene.tissue(2));
    for (const PlanPose& pose : scene.poses) try {
        show_progress(fmt::format("scene {}, {}, {} pairs", n, scene.kind, f.pairs.size()));
        Pair pair = measure_pair(models, coarse, fine, scene, pose);
        pair.scene = n;
        if (!arguments.quick && checked.size() < arguments.finer &&
            std::ranges::find(checked, scene.kind) == checked.end()) {
          RigidContact finest(device->queue(), scene.tissue(4));
          pair.finer_n = extrapolated(pair.fine_n, mean_over_shifts(finest, pose, kVoxelM / 4, 1));
          checked.push_back(scene.kind);
        }
        f.pairs.push_back(std::move(pair));
      } catch (const std::exception& e) {
        f.failures.push_back(fmt::format("scene {}, {}, x {} z {} d {}: {}", n, scene.kind, pose.x_m,
                                         pose.z_m, pose.indentation_m, e.what()));
      }
  }
  ready.put(f);
}

// The pairs of an earlier run; times anew, of a few of its scenes.
Figures earlier_pairs(const std::shared_ptr<service::Device>& device, const Arguments& arguments) {
  constexpr std::size_t kScenes = 8;
  SuiteOptions earlier = arguments;
  earlier.replot = arguments.pairs_of, earlier.out = ".";  // nothing is drawn there
  Figures f = earlier_figures("plan", earlier).get<Figures>();
  PlanModels models(device, true);
  Readiness ready;
  for (std::size_t n = 0; n < kScenes; ++n) {
    const PlanScene scene = plan_scene(f.seed, n, 1, false);
    ready.add(scene, models.enter(scene, true));
  }
  ready.put(f);
  return f;
}

Figures measure(const Arguments& arguments, Promises& promises) {
  const auto device = service::Device::open();
  Figures f{.seed = arguments.seed};
  if (!arguments.pairs_of.empty())
    f = earlier_pairs(device, arguments);
  else if (arguments.pairs > 0)
    measure_pairs(device, arguments, f);
  if (!f.pairs.empty()) sum_up(f);
  f.cases = hard_cases(device, arguments.quick, [](const HardCase& c) { print(c); });
  f.changes_on_a_border = changes_on_a_border(device);
  std::printf("plan: a finger on a border for ten minutes: %zu changes of model\n", f.changes_on_a_border);
  promise(f, promises);
  return f;
}

// Those that nothing quicker is better than.
Curve front(std::vector<Summary> all, double Summary::*error, const char* title) {
  std::erase_if(all, [](const Summary& s) { return s.model.starts_with("planned"); });
  std::ranges::sort(all, {}, &Summary::ms);
  Curve out{.title = title, .style = "steps lw 2 lc rgb '#888888'"};
  double best = HUGE_VAL;
  for (const Summary& s : all)
    if (s.*error < best) out.add(s.ms, 100 * (best = s.*error));
  return out;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  if (f.pairs.empty()) return;
  std::vector<Summary> all = f.summaries;
  std::erase_if(all, [](const Summary& s) { return s.kind != "all"; });
  Curve half{.title = "half of the pairs", .line = false}, most{.title = "95 % of the pairs", .line = false};
  Curve planned{.title = "95 %, planned at 1, 3, 5 and 10 %"};
  std::string labels;
  for (const Summary& s : all) {
    const auto of_plan = std::ranges::find(f.planned, s.model, planned_name);
    if (of_plan != f.planned.end()) {
      planned.add(of_plan->ms, 100 * s.p95);
      continue;
    }
    half.add(s.ms, 100 * s.p50), most.add(s.ms, 100 * s.p95);
    labels +=
        fmt::format("set label '{}' at {:.6g},{:.6g} offset 0.6,0.4 font ',8'\n", s.model, s.ms, 100 * s.p95);
  }
  plot(folder / "plan.png",
       script_of(
           {half, most, planned, front(all, &Summary::p50, "no quicker one is better"),
            front(all, &Summary::p95, "")},
           "set logscale xy\nset format x '10^{%L}'\nset key outside bottom center horizontal\n" + labels +
               axes(fmt::format("Touch of solid tissue: {} pairs of a scene and a pose", f.pairs.size()),
                    "processor time of a touch (ms)", "off the true force (%)")));
}

}  // namespace
}  // namespace plan

void add_plan_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<plan::Arguments>();
  CLI::App& command = add_suite(app, "plan", "models of a touch of solid tissue: speed against accuracy",
                                arguments, met, plan::measure, plan::draw);
  command.add_option("--pairs", arguments->pairs, "scenes times poses; 0: the hard cases alone");
  command.add_option("--finer", arguments->finer,
                     "pairs, each of another kind, whose truth is checked on nodes 0.5 mm apart");
  command.add_flag("--offered", arguments->offered,
                   "the planner's offers alone: a third of the time, for many pairs");
  command.add_option("--minutes", arguments->minutes, "no scene is begun after so many");
  command.add_option("--pairs-of", arguments->pairs_of,
                     "pairs and times of an earlier --json instead: the hard cases are measured anew");
  command.add_option("--seed", arguments->seed, "of the tissues and poses");
}

}  // namespace teletact::bench
