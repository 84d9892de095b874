// The method of constant stimuli: every stimulus equally often, in random order, one answer each.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "client/experiment/random.h"

namespace teletact::client {

constexpr const char* kPerfectStiffness = "perfect";

struct Trial {
  double background_n_m = 0;                  // felt first
  double stimulus_n_m = 0;                    // felt second
  std::string condition = kPerfectStiffness;  // what lies between these and who feels them
};

struct AnsweredTrial {
  Trial trial;
  bool harder = false;  // the second was judged harder
};

struct ExperimentPlan {
  double background_n_m = 25;
  // The paper's stimuli reach no lower than the background; these reach below it too, so that the whole curve
  // of an unbiased observer is seen.
  std::vector<double> stimuli_n_m{15, 20, 22.5, 25, 27.5, 30, 32.5, 35, 37.5, 45};
  unsigned trials_per_stimulus = 40;
  std::string condition = kPerfectStiffness;
};

// Throws std::invalid_argument naming the field: stiffness not above zero or not finite, fewer than two
// stimuli, one given twice, no trials, more than 1e6 of them.
void validate(const ExperimentPlan&);

// The plan's trials in random order. Throws as validate().
std::vector<Trial> random_order(const ExperimentPlan&, Random&);

// One judgement; nothing when the person ends the experiment early.
using Observer = std::function<std::optional<bool>(const Trial&, std::size_t number, std::size_t of)>;

// Asks for each trial in turn until the observer ends; `record` is called after every answer.
std::vector<AnsweredTrial> run_experiment(const std::vector<Trial>&, const Observer&,
                                          const std::function<void(const AnsweredTrial&)>& record = {});

// Answers of one stimulus.
struct StimulusCount {
  double stimulus_n_m = 0;
  unsigned harder = 0, not_harder = 0;
  unsigned trials() const { return harder + not_harder; }
  double share_harder() const { return static_cast<double>(harder) / trials(); }  // trials() > 0
};

// In increasing order of the stimulus, stimuli without trials left out. Throws std::invalid_argument when the
// backgrounds or the conditions of the answers differ: a fit to such counts would be of neither.
std::vector<StimulusCount> count_answers(const std::vector<AnsweredTrial>&);

}  // namespace teletact::client
