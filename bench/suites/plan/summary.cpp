#include "bench/suites/plan/summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <set>
#include <utility>

#include "bench/basics/median.h"
#include "bench/suite.h"
#include "bench/suites/plan/models.h"

namespace teletact::bench::plan {

bool within_budget(const Answer& a) {
  return a.budget > 0 && std::abs(a.error) <= a.budget;
}

std::string planned_name(const Planned& p) {
  return fmt::format("planned {:.0f} %", 100 * p.tolerance);
}

namespace {

// As a touch asks for that asks for nothing, unless said.
bool suffices(const Pair& pair, const Answer& a, double tolerance = 0.03) {
  return std::abs(a.force_n - pair.truth_n) <= tolerance * std::max(pair.truth_n, kPlanFloor);
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

Planned planned_of(const std::vector<Pair>& pairs, double tolerance) {
  Planned out{.tolerance = tolerance};
  const std::string name = planned_name(out);
  const double each = 1 / double(pairs.size());
  for (const Pair& pair : pairs) {
    double cheapest_ms = HUGE_VAL;
    for (const Answer& a : pair.answers) {
      const bool offered = a.model == "M1" || a.model == "M3";
      if (offered && suffices(pair, a, tolerance)) cheapest_ms = std::min(cheapest_ms, a.ms);
      if (a.model == "M3") out.finest_ms += each * a.ms;
    }
    const Answer& a = *std::ranges::find(pair.answers, name, &Answer::model);
    const bool said = a.budget * a.force_n > tolerance * std::max(a.force_n, kPlanFloor);
    out.said += each * said;
    out.missed += each * (!said && !suffices(pair, a, tolerance));
    out.cheap += each * (a.ms <= 1.5 * cheapest_ms + 1);
    out.ms += each * a.ms;
    (a.by == "M1" ? out.by_m1 : out.by_m3) += each;
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
      "plan: planned at %2.0f %%: M1 %.0f %%, M3 %.0f %%; missed %.1f %%, said "
      "beforehand %.1f %%, cheap enough %.0f %%; %.3g ms a touch, M3 %.3g\n",
      100 * p.tolerance, 100 * p.by_m1, 100 * p.by_m3, 100 * p.missed, 100 * p.said, 100 * p.cheap, p.ms,
      p.finest_ms);
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

}  // namespace

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

}  // namespace teletact::bench::plan
