#include "client/experiment/trials.h"

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <set>
#include <stdexcept>

namespace teletact::client {
namespace {

constexpr double kTrialsMax = 1e6;

void require_stiffness(double value_n_m, const char* field) {
  if (!(value_n_m > 0) || !std::isfinite(value_n_m))
    throw std::invalid_argument(std::string(field) + ": give stiffness above zero, in N/m");
}

void require_alike(const Trial& first, const Trial& other) {
  if (other.background_n_m != first.background_n_m)
    throw std::invalid_argument("the trials have different backgrounds; a fit needs one");
  if (other.condition != first.condition)
    throw std::invalid_argument("some stimuli were felt as '" + first.condition + "', others as '" +
                                other.condition +
                                "'; a fit needs one condition: give each a file of its own");
}

std::string words_of(const Trial& trial) {
  return fmt::format("{:g} {} {:g} N/m, felt as '{}'", trial.stimulus_n_m,
                     trial.stimulus_first ? "before" : "after", trial.background_n_m, trial.condition);
}

void require_begun(const std::vector<Trial>& trials, const std::vector<AnsweredTrial>& answers) {
  const std::string remedy = "; give the options that it was begun with";
  if (answers.size() > trials.size())
    throw std::invalid_argument(fmt::format("{} trials were answered, of {}", answers.size(), trials.size()) +
                                remedy);
  for (std::size_t k = 0; k < answers.size(); ++k)
    if (answers[k].trial != trials[k])
      throw std::invalid_argument(fmt::format("trial {} was {}, but is {} now", k + 1,
                                              words_of(answers[k].trial), words_of(trials[k])) +
                                  remedy);
}

}  // namespace

void validate(const ExperimentPlan& plan) {
  require_stiffness(plan.background_n_m, "background_n_m");
  for (const double s : plan.stimuli_n_m) require_stiffness(s, "stimuli_n_m");
  const std::set<double> different(plan.stimuli_n_m.begin(), plan.stimuli_n_m.end());
  if (different.size() < 2) throw std::invalid_argument("stimuli_n_m: give at least two");
  if (different.size() != plan.stimuli_n_m.size())
    throw std::invalid_argument("stimuli_n_m: one is given twice");
  if (plan.trials_per_stimulus < 1) throw std::invalid_argument("trials_per_stimulus: give at least one");
  if (plan.counterbalanced && plan.trials_per_stimulus % 2 != 0)
    throw std::invalid_argument("trials_per_stimulus: give an even number to counterbalance");
  if (static_cast<double>(plan.trials_per_stimulus) * static_cast<double>(different.size()) > kTrialsMax)
    throw std::invalid_argument("trials_per_stimulus: more than a million trials in all");
}

std::vector<Trial> random_order(const ExperimentPlan& plan, Random& random) {
  validate(plan);
  std::vector<Trial> trials;
  trials.reserve(plan.stimuli_n_m.size() * plan.trials_per_stimulus);
  for (const double stimulus_n_m : plan.stimuli_n_m)
    for (unsigned k = 0; k < plan.trials_per_stimulus; ++k)
      trials.push_back(
          {plan.background_n_m, stimulus_n_m, plan.condition, plan.counterbalanced && k % 2 == 1});
  random.shuffle(trials);
  return trials;
}

std::vector<AnsweredTrial> run_experiment(const std::vector<Trial>& trials, const Observer& observer,
                                          const std::function<void(const AnsweredTrial&)>& record,
                                          std::vector<AnsweredTrial> earlier) {
  std::vector<AnsweredTrial>& answers = earlier;
  require_begun(trials, answers);
  while (answers.size() < trials.size()) {
    const Trial& trial = trials[answers.size()];
    const std::optional<bool> harder = observer(trial, answers.size() + 1, trials.size());
    if (!harder) break;
    answers.push_back({trial, *harder});
    if (record) record(answers.back());
  }
  return answers;
}

std::vector<StimulusCount> count_answers(const std::vector<AnsweredTrial>& answers) {
  std::map<double, StimulusCount> counts;
  for (const AnsweredTrial& answer : answers) {
    require_alike(answers.front().trial, answer.trial);
    StimulusCount& count = counts[answer.trial.stimulus_n_m];
    count.stimulus_n_m = answer.trial.stimulus_n_m;
    ++(answer.harder ? count.harder : count.not_harder);
  }
  std::vector<StimulusCount> out;
  out.reserve(counts.size());
  for (const auto& [stimulus_n_m, count] : counts) out.push_back(count);
  return out;
}

}  // namespace teletact::client
