// The figures of the plan chart, as its --json has them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "bench/suites/plan/cases.h"
#include "bench/suites/plan/scenes.h"

namespace teletact::bench::plan {

struct Answer {
  std::string model;
  double force_n = 0, ms = 0;
  double error = 0;   // over the truth
  double beside = 0;  // over what the solid converges to on the same nodes
  double stated = 0;  // 0: it states none
  double budget = 0;  // half width, without finite strain; 0: it states none
  std::string by;     // the model that a planner took
};

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

// The same of all pairs, of the models that state what they are off by or are offered.
struct Model {
  std::string model;
  double ms = 0, p50 = 0, p95 = 0, most = 0, suffices = 0, cheapest = 0, budget_covers = 0,
         budget_over_error = 0;
};

// Shares of a class of pairs that budgets cover.
struct Class {
  std::string pairs_of;
  std::size_t pairs = 0, scenes = 0;
  double m1_covers = 0, m3_covers = 0, planned_covers = 0;  // planned at 3 %
};

// Medians over the scenes of what is learned before shares are known, ms of the processor (models.h).
struct Learning {
  std::size_t nodes = 0;
  double fields_ms = 0, slice_ms = 0, tip_ms = 0;
};

// The planner's choices at one tolerance: shares of the pairs.
struct Planned {
  double tolerance = 0;
  double missed = 0;             // beyond it, and the budget does not say so
  double said = 0;               // the budget is beyond it
  double cheap = 0;              // takes at most 1.5 times the cheapest that is within it, and 1 ms
  double ms = 0, finest_ms = 0;  // of the processor, in the mean: its own, and of M3 for all
  double by_m1 = 0, by_m3 = 0;
};

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

}  // namespace teletact::bench::plan
