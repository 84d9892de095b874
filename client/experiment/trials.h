// The method of constant stimuli: every stimulus equally often, in random order, one answer each. Which of
// two is felt first may bias who judges them (the time-order error): counterbalanced trials take that out.
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
  double background_n_m = 0;
  double stimulus_n_m = 0;
  std::string condition = kPerfectStiffness;  // what lies between these and who feels them
  bool stimulus_first = false;                // the background is felt first
  bool operator==(const Trial&) const = default;
};

struct AnsweredTrial {
  Trial trial;
  bool harder = false;  // the stimulus was judged harder
};

struct ExperimentPlan {
  double background_n_m = 25;
  // The paper's stimuli reach no lower than the background; these reach below it too, so that the whole curve
  // of an unbiased observer is seen.
  std::vector<double> stimuli_n_m{15, 20, 22.5, 25, 27.5, 30, 32.5, 35, 37.5, 45};
  unsigned trials_per_stimulus = 40;
  std::string condition = kPerfectStiffness;
  bool counterbalanced = false;  // half of each stimulus's trials have it first
};

// Throws std::invalid_argument naming the field: stiffness not above zero or not finite, fewer than two
// stimuli, one given twice, no trials, more than 1e6 of them, an odd number to be counterbalanced.
void validate(const ExperimentPlan&);

// The plan's trials in random order. Throws as validate().
std::vector<Trial> random_order(const ExperimentPlan&, Random&);

// One judgement; nothing when the person ends the experiment early.
using Observer = std::function<std::optional<bool>(const Trial&, std::size_t number, std::size_t of)>;

// Asks for each trial in turn until the observer ends; `record` is called after every answer. `earlier`: what
// was answered before of the same trials; all answers are returned. Throws std::invalid_argument where they
// are not of the first of these trials.
std::vector<AnsweredTrial> run_experiment(const std::vector<Trial>&, const Observer&,
                                          const std::function<void(const AnsweredTrial&)>& record = {},
                                          std::vector<AnsweredTrial> earlier = {});

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
