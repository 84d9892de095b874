// teletact-bench plan: models of a touch of solid tissue, speed against accuracy, each against a truth (T9).
// Over 400 lines: the figures, what sums them up and what prints them change together.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <utility>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/rigid_contact.h"
#include "bench/suite.h"
#include "bench/suites/plan/cases.h"
#include "bench/suites/plan/models.h"
#include "bench/suites/plan/scenes.h"
#include "bench/suites/plan/truth.h"

namespace teletact::bench {
namespace {

struct Arguments : SuiteOptions {
  std::size_t pairs = 1000, finer = 6;
  std::uint64_t seed = 1;
  bool offered = false;
  double minutes = 1e6;
  std::string pairs_of;  // --json of an earlier run
};

struct Answer {
  std::string model;
  double force_n = 0, ms = 0;
  double error = 0;   // over the truth
  double beside = 0;  // over what the solid converges to on the same nodes
  double stated = 0;  // 0: it states none
  double budget = 0;  // half width, without finite strain; 0: it states none
  std::string by;     // the model that a planner took
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Answer, model, force_n, ms, error, beside, stated, budget, by)

struct Pair {
  std::size_t scene = 0;
  std::string kind;
  double poisson_ratio = 0, texture = 0;
  std::vector<PlanLump> lumps{};
  PlanPose pose{};
  double coarse_n = 0, fine_n = 0, truth_n = 0;  // rigid, nodes 2 and 1 mm apart, extrapolated
  double finer_n = 0;                            // extrapolated from 1 and 0.5 mm; 0: not computed
  double layer_n = 0;                            // exact, of the mean modulus
  std::vector<Answer> answers{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Pair, scene, kind, poisson_ratio, texture, lumps, pose, coarse_n, fine_n,
                                   truth_n, finer_n, layer_n, answers)

// Sizes of the errors of one model's pairs of a kind, "all" for all.
struct Summary {
  std::string kind, model;
  std::size_t pairs = 0;
  double ms = 0;  // median
  double p50 = 0, p95 = 0, most = 0, beside_p50 = 0, beside_p95 = 0, beside_most = 0;
  double covered = 0;  // by what is stated, of what it is off by beside the mesh
  // Of the budget: how often it covers what the model is off the truth by; its median over the error's.
  double budget_covers = 0, budget_over_error = 0;
  // Shares of the pairs: within the tolerance; and nothing quicker is.
  double suffices = 0, cheapest = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Summary, kind, model, pairs, ms, p50, p95, most, beside_p50, beside_p95,
                                   beside_most, covered, budget_covers, budget_over_error, suffices, cheapest)

// The same of all pairs, of the models that state what they are off by or are offered.
struct Model {
  std::string model;
  double ms = 0, p50 = 0, p95 = 0, most = 0, suffices = 0, cheapest = 0, budget_covers = 0,
         budget_over_error = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Model, model, ms, p50, p95, most, suffices, cheapest, budget_covers,
                                   budget_over_error)

// Shares of a class of pairs that budgets cover.
struct Class {
  std::string pairs_of;
  std::size_t pairs = 0, scenes = 0;
  double m1_covers = 0, m3_covers = 0, planned_covers = 0;  // planned at 3 %
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Class, pairs_of, pairs, scenes, m1_covers, m3_covers, planned_covers)

// Medians over the scenes of what is learned before closed forms are known, ms of the processor (models.h).
struct Learning {
  std::size_t nodes = 0;
  double fields_ms = 0, slice_ms = 0, tip_ms = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Learning, nodes, fields_ms, slice_ms, tip_ms)

// The planner's choices at one tolerance: shares of the pairs.
struct Planned {
  double tolerance = 0;
  double missed = 0;             // beyond it, and the budget does not say so
  double said = 0;               // the budget is beyond it
  double cheap = 0;              // takes at most 1.5 times the cheapest that is within it, and 1 ms
  double ms = 0, finest_ms = 0;  // of the processor, in the mean: its own, and of M3 for all
  double by_m0 = 0, by_m2 = 0, by_m1 = 0, by_m3 = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Planned, tolerance, missed, said, cheap, ms, finest_ms, by_m0, by_m2,
                                   by_m1, by_m3)

struct Figures {
  std::uint64_t seed = 0;
  double m3_ready_ms = 0, m4_ready_ms = 0;  // medians, for a scene
  std::size_t changes_on_a_border = 0;      // in ten minutes (cases.h)
  std::vector<Learning> learning{};
  std::vector<Model> models{};
  std::vector<Summary> summaries{};
  std::vector<Class> classes{};
  std::vector<Planned> planned{};
  std::vector<HardCase> cases{};
  std::vector<std::string> failures{};
  std::vector<Pair> pairs{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, seed, m3_ready_ms, m4_ready_ms, changes_on_a_border, learning,
                                   models, summaries, classes, planned, cases, failures, pairs)

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

// As a touch asks for that asks for nothing, unless said.
bool suffices(const Pair& pair, const Answer& a, double tolerance = 0.03) {
  return std::abs(a.force_n - pair.truth_n) <= tolerance * std::max(pair.truth_n, kPlanFloor);
}

bool within_budget(const Answer& a) {
  return a.budget > 0 && std::abs(a.error) <= a.budget;
}

Summary summary_of(const std::vector<Pair>& pairs, const std::string& kind, std::size_t model) {
  Summary s{.kind = kind, .model = pairs.front().answers[model].model};
  std::vector<double> ms, errors, beside, budgets;
  for (const Pair& pair : pairs) {
    if (kind != "all" && pair.kind != kind) continue;
    const Answer& a = pair.answers[model];
    ms.push_back(a.ms), errors.push_back(std::abs(a.error)), beside.push_back(std::abs(a.beside));
    s.suffices += suffices(pair, a);
    s.cheapest += suffices(pair, a) && std::ranges::none_of(pair.answers, [&](const Answer& other) {
                    return other.ms < a.ms && suffices(pair, other);
                  });
    s.covered += a.stated > 0 && std::abs(a.beside) <= a.stated;
    s.budget_covers += within_budget(a);
    budgets.push_back(a.budget);
  }
  s.pairs = ms.size(), s.ms = median_of(ms), s.covered /= double(s.pairs);
  s.budget_covers /= double(s.pairs), s.budget_over_error = median_of(budgets) / median_of(errors);
  s.suffices /= double(s.pairs), s.cheapest /= double(s.pairs);
  const Quantiles e = quantiles(errors), b = quantiles(beside);
  s.p50 = e.p50, s.p95 = e.p95, s.most = e.max;
  s.beside_p50 = b.p50, s.beside_p95 = b.p95, s.beside_most = b.max;
  return s;
}

std::string planned_name(const Planned& p) {
  return fmt::format("planned {:.0f} %", 100 * p.tolerance);
}

Planned planned_of(const std::vector<Pair>& pairs, double tolerance) {
  Planned out{.tolerance = tolerance};
  const std::string name = planned_name(out);
  const double each = 1 / double(pairs.size());
  for (const Pair& pair : pairs) {
    double cheapest_ms = HUGE_VAL;
    for (const Answer& a : pair.answers) {
      const bool offered = a.model == "M0" || a.model == "M2" || a.model == "M1" || a.model == "M3";
      if (offered && suffices(pair, a, tolerance)) cheapest_ms = std::min(cheapest_ms, a.ms);
      if (a.model == "M3") out.finest_ms += each * a.ms;
    }
    const Answer& a = *std::ranges::find(pair.answers, name, &Answer::model);
    const bool said = a.budget * a.force_n > tolerance * std::max(a.force_n, kPlanFloor);
    out.said += each * said;
    out.missed += each * (!said && !suffices(pair, a, tolerance));
    out.cheap += each * (a.ms <= 1.5 * cheapest_ms + 1);
    out.ms += each * a.ms;
    (a.by == "M0" ? out.by_m0 : a.by == "M2" ? out.by_m2 : a.by == "M1" ? out.by_m1 : out.by_m3) += each;
  }
  return out;
}

constexpr double kShallowM = 0.0014;  // half of the poses, about

std::vector<Class> classes_of(const std::vector<Pair>& pairs) {
  std::vector<std::pair<std::string, std::function<bool(const Pair&)>>> all{
      {"all", [](const Pair&) { return true; }},
      {"with lumps", [](const Pair& p) { return !p.lumps.empty(); }},
      {"without", [](const Pair& p) { return p.lumps.empty(); }},
      {"nu 0.49 and more", [](const Pair& p) { return p.poisson_ratio > 0.485; }},
      {"nu less", [](const Pair& p) { return p.poisson_ratio < 0.485; }},
      {"less than 1.4 mm deep", [](const Pair& p) { return p.pose.indentation_m < kShallowM; }},
      {"deeper", [](const Pair& p) { return p.pose.indentation_m >= kShallowM; }}};
  std::vector<std::string> kinds;
  for (const Pair& p : pairs)
    if (std::ranges::find(kinds, p.kind) == kinds.end()) kinds.push_back(p.kind);
  for (const std::string& kind : kinds)
    all.emplace_back(kind, [kind](const Pair& p) { return p.kind == kind; });
  std::vector<Class> out;
  for (const auto& [name, holds] : all) {
    Class c{.pairs_of = name};
    std::set<std::size_t> scenes;
    for (const Pair& pair : pairs) {
      if (!holds(pair)) continue;
      ++c.pairs, scenes.insert(pair.scene);
      for (const Answer& a : pair.answers)
        (a.model == "M1"   ? c.m1_covers
         : a.model == "M3" ? c.m3_covers
                           : c.planned_covers) +=
            (a.model == "M1" || a.model == "M3" || a.model == "planned 3 %") && within_budget(a);
    }
    if (c.pairs == 0) continue;
    c.scenes = scenes.size();
    for (double* share : {&c.m1_covers, &c.m3_covers, &c.planned_covers}) *share /= double(c.pairs);
    out.push_back(c);
  }
  return out;
}

std::vector<Model> models_of(const std::vector<Summary>& summaries) {
  std::vector<Model> out;
  for (const Summary& s : summaries)
    if (s.kind == "all")
      out.push_back({s.model, s.ms, s.p50, s.p95, s.most, s.suffices, s.cheapest, s.budget_covers,
                     s.budget_over_error});
  return out;
}

std::vector<Summary> summaries_of(const std::vector<Pair>& pairs) {
  std::vector<Summary> out;
  if (pairs.empty()) throw BenchError("no pair has a truth");
  std::vector<std::string> kinds{"all"};
  for (const Pair& pair : pairs)
    if (std::ranges::find(kinds, pair.kind) == kinds.end()) kinds.push_back(pair.kind);
  for (const std::string& kind : kinds)
    for (std::size_t model = 0; model < pairs.front().answers.size(); ++model)
      out.push_back(summary_of(pairs, kind, model));
  return out;
}

void print(const std::vector<Summary>& summaries) {
  std::printf("plan: %-13s %10s  off the truth by %%            off the same mesh by %%\n", "all", "ms");
  std::vector<std::string> models;
  std::string kinds;
  for (const Summary& s : summaries) {
    if (s.kind == "all") {
      models.push_back(s.model);
      std::printf(
          "plan: %-13s %10.4g  %6.2f /%6.2f /%6.1f  %6.2f /%6.2f /%6.1f  suffices %3.0f %%, cheapest %2.0f "
          "%%%s%s\n",
          s.model.c_str(), s.ms, 100 * s.p50, 100 * s.p95, 100 * s.most, 100 * s.beside_p50,
          100 * s.beside_p95, 100 * s.beside_most, 100 * s.suffices, 100 * s.cheapest,
          s.covered > 0 ? fmt::format(", stated covers {:3.0f} %", 100 * s.covered).c_str() : "",
          s.budget_over_error > 0 ? fmt::format(", budget covers the truth {:3.0f} %, {:.1f} times the error",
                                                100 * s.budget_covers, s.budget_over_error)
                                        .c_str()
                                  : "");
    } else if (s.model == models.front()) {
      kinds += fmt::format(" {:>20}", fmt::format("{} ({})", s.kind, s.pairs));
    }
  }
  std::printf("plan: off by %%: median / 95 %% / worst\nplan: %-13s%s\n", "", kinds.c_str());
  for (const std::string& model : models) {
    std::string line;
    for (const Summary& s : summaries)
      if (s.kind != "all" && s.model == model)
        line += fmt::format(" {:>20}",
                            fmt::format("{:.2f}/{:.1f}/{:.1f}", 100 * s.p50, 100 * s.p95, 100 * s.most));
    std::printf("plan: %-13s%s\n", model.c_str(), line.c_str());
  }
}

void print(const Planned& p) {
  std::printf(
      "plan: planned at %2.0f %%: M0 %.0f %%, M2 %.0f %%, M1 %.0f %%, M3 %.0f %%; missed %.1f %%, said "
      "beforehand %.1f %%, cheap enough %.0f %%; %.3g ms a touch, M3 %.3g\n",
      100 * p.tolerance, 100 * p.by_m0, 100 * p.by_m2, 100 * p.by_m1, 100 * p.by_m3, 100 * p.missed,
      100 * p.said, 100 * p.cheap, p.ms, p.finest_ms);
}

void print(const Class& c) {
  std::printf(
      "plan: budgets of %-22s (%4zu pairs, %3zu scenes) cover M1 %5.1f %%, M3 %5.1f %%, planned %5.1f %%\n",
      c.pairs_of.c_str(), c.pairs, c.scenes, 100 * c.m1_covers, 100 * c.m3_covers, 100 * c.planned_covers);
}

void print(const Learning& l) {
  std::printf("plan: learned on %6zu nodes: a factor's fields %.1f ms, a slice %.2f, a tip %.1f\n", l.nodes,
              l.fields_ms, l.slice_ms, l.tip_ms);
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

// What follows from the pairs.
void sum_up(Figures& f) {
  f.summaries = summaries_of(f.pairs);
  f.models = models_of(f.summaries);
  f.classes = classes_of(f.pairs);
  f.planned.clear();
  for (const double tolerance : kPlanTolerances) f.planned.push_back(planned_of(f.pairs, tolerance));
  print(f.summaries);
  for (const Class& c : f.classes) print(c);
  for (const Planned& p : f.planned) print(p);
  std::printf("plan: made ready for a scene: M3 %.1f ms, M4 %.0f ms\n", f.m3_ready_ms, f.m4_ready_ms);
  for (const Learning& l : f.learning) print(l);
  for (const std::string& failure : f.failures) std::printf("plan: %s\n", failure.c_str());
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

void add_plan_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = add_suite(app, "plan", "models of a touch of solid tissue: speed against accuracy",
                                arguments, met, measure, draw);
  command.add_option("--pairs", arguments->pairs, "scenes times poses; 0: the hard cases alone")
      ->capture_default_str();
  command
      .add_option("--finer", arguments->finer,
                  "pairs, each of another kind, whose truth is checked on nodes 0.5 mm apart")
      ->capture_default_str();
  command.add_flag("--offered", arguments->offered,
                   "the planner's offers alone: a third of the time, for many pairs");
  command.add_option("--minutes", arguments->minutes, "no scene is begun after so many");
  command.add_option("--pairs-of", arguments->pairs_of,
                     "pairs and times of an earlier --json instead: the hard cases are measured anew");
  command.add_option("--seed", arguments->seed, "of the tissues and poses")->capture_default_str();
}

}  // namespace teletact::bench
