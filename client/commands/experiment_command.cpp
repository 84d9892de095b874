// teletact-client experiment: the paper's question, "is the inclusion harder?" (T6.4), put to a simulated
// observer or to a person, of springs of this machine or of tissue on a service, and its fit.
#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <iostream>
#include <memory>

#include "client/commands/commands.h"
#include "client/commands/experiment_options.h"
#include "client/experiment/bootstrap.h"
#include "client/experiment/endable_input.h"
#include "client/experiment/observer.h"
#include "client/experiment/person.h"
#include "client/experiment/results_csv.h"
#include "client/experiment/spring_display.h"
#include "client/servo/ending.h"
#include "client/session/devices.h"
#include "client/stimuli/tissue_display.h"

namespace teletact::client {
namespace {

// As given, as the answers were made with, or 1.
std::uint64_t seed_of(const ExperimentArguments& arguments) {
  if (arguments.seed) return *arguments.seed;
  constexpr std::uint64_t kUsual = 1;
  if (arguments.resume.empty())
    return arguments.refit.empty() ? kUsual : seed_of_results_csv(arguments.refit).value_or(kUsual);
  if (const auto seed = seed_of_results_csv(arguments.resume)) return *seed;
  throw CommandError(arguments.resume +
                     " cannot be read, or states no seed: the order of its trials is not known");
}

std::string touch_renderer(const ExperimentArguments& arguments) {
  return arguments.renderer.empty() ? "law" : arguments.renderer;
}

std::string remark_of(const ExperimentArguments& arguments) {
  const std::string who =
      arguments.person
          ? "a person at " + (arguments.device.device.empty() ? "the keyboard" : arguments.device.device)
          : fmt::format("simulated, Weber fraction {}, lapse rate {}, equality {}",
                        arguments.observer.weber_fraction, arguments.observer.lapse_rate,
                        arguments.observer.equality_fraction);
  return fmt::format("teletact experiment: seed {}, {} trials of each stimulus; observer: {}",
                     seed_of(arguments), arguments.plan.trials_per_stimulus, who);
}

std::optional<SpringChain> chain_of(const ExperimentArguments& arguments) {
  return arguments.renderer.empty() ? std::nullopt : std::optional(arguments.chain);
}

double hardest_n_m(const ExperimentPlan& plan) {
  return std::max(plan.background_n_m, *std::max_element(plan.stimuli_n_m.begin(), plan.stimuli_n_m.end()));
}

// What a hand feels: nothing where nobody touches.
struct Apparatus {
  std::unique_ptr<StimulusScenes> scenes;
  std::unique_ptr<HapticDevice> device;
  std::unique_ptr<StimulusDisplay> display;
};

Apparatus springs(const ExperimentArguments& arguments) {
  Apparatus out;
  if (!arguments.person || arguments.device.device.empty()) return out;
  out.device = make_device(arguments.device);
  auto display =
      std::make_unique<SpringDisplay>(*out.device, true, chain_of(arguments), arguments.tissue.place);
  display->require(hardest_n_m(arguments.plan));  // before anybody is asked
  out.display = std::move(display);
  return out;
}

// A hand that rests on the stimulus, or passes over it and back. It presses once the force is whole.
HandOptions simulated_hand(const TissueOptions& tissue, const StimulusScenes& scenes) {
  constexpr double kHoverM = 0.015, kRestM = 0.004, kPassMS = 0.05, kRestMS = 0.02;
  HandOptions hand;
  hand.indentation_m = tissue.depth_m;
  hand.hover_m = kHoverM;
  hand.start_m = hand.begin_m = scenes.start_m().x();
  const double middle_m = scenes.middle_m().x();
  hand.end_m = tissue.place.width_m > 0 ? 2 * middle_m - hand.begin_m : hand.begin_m + kRestM;
  hand.speed_m_s = tissue.place.width_m > 0 ? kPassMS : kRestMS;
  return hand;
}

Apparatus tissues(const ExperimentArguments& arguments, const std::atomic<bool>& stop) {
  Apparatus out;
  // What a link says beside is no news to who judges: of what is lost the observer is told.
  auto logger = spdlog::get("experiment");
  if (!logger) logger = spdlog::stderr_color_mt("experiment");
  logger->set_level(spdlog::level::err);
  spdlog::set_default_logger(logger);
  out.scenes = std::make_unique<StimulusScenes>(arguments.tissue, stop, say);
  DeviceChoice choice = arguments.device;
  if (choice.device.empty()) choice.device = "simulated";
  if (is_real(choice.device))
    choice.hand.start_m = out.scenes->start_m().x();
  else
    choice.hand = simulated_hand(arguments.tissue, *out.scenes);
  out.device = make_device(choice);
  require_shown(out.device->profile(), hardest_n_m(arguments.plan));
  say("making the tissues, and touching each");
  out.scenes->make(arguments.plan.stimuli_n_m, arguments.plan.background_n_m);
  out.display = std::make_unique<TissueDisplay>(*out.device, *out.scenes, touch_renderer(arguments), true);
  return out;
}

// Where answers are kept, and those that are there already.
struct Kept {
  std::string path;
  std::vector<AnsweredTrial> earlier;
  std::optional<ResultsCsv> csv;
};

Kept kept_by(const ExperimentArguments& arguments, const std::vector<Trial>& trials) {
  Kept kept;
  if (!arguments.resume.empty()) {
    kept.path = arguments.resume;
    const auto nobody = [](const Trial&, std::size_t, std::size_t) { return std::optional<bool>(); };
    kept.earlier = run_experiment(trials, nobody, {}, read_results_csv(kept.path));  // they are of these
    kept.csv = ResultsCsv::going_on(kept.path, kept.earlier.size());
  } else if (!arguments.csv.empty()) {
    kept.path = arguments.csv;
    kept.csv.emplace(kept.path, remark_of(arguments));
  }
  return kept;
}

// The order of the trials and the observer's chance come from one seed, but from generators of their own, so
// that a person is asked in the same order.
std::vector<AnsweredTrial> ask(const ExperimentArguments& arguments) {
  Random random(seed_of(arguments));
  ExperimentPlan plan = arguments.plan;
  plan.condition = arguments.by_service() ? condition_of(touch_renderer(arguments), arguments.tissue)
                                          : condition_of(chain_of(arguments), arguments.tissue.place);
  const std::vector<Trial> trials = random_order(plan, random);
  const auto function = [&] { return psychometric_function(arguments.observer, plan.background_n_m); };
  if (!arguments.person) function();  // refuses what it must before anything begins
  Kept kept = kept_by(arguments, trials);
  std::size_t answered = kept.earlier.size();
  if (answered == trials.size()) return kept.earlier;
  const std::atomic<bool>& end = end_in_order();
  EndableInput typed(STDIN_FILENO, end);
  std::istream in(&typed);
  try {
    const Apparatus apparatus = arguments.by_service() ? tissues(arguments, end) : springs(arguments);
    const Observer observer =
        apparatus.display
            ? (arguments.person
                   ? device_observer(*apparatus.display, in, std::cout)
                   : touching_observer(*apparatus.display, function(), random.seed(), end, std::cout))
        : arguments.person ? keyboard_observer(in, std::cout, hardest_n_m(plan) * kKeyboardDeepestM)
                           : simulated_observer(function(), random.seed());
    const auto record = [&](const AnsweredTrial& answer) {
      if (kept.csv) kept.csv->add(answer);
      ++answered;
    };
    return run_experiment(trials, observer, record, kept.earlier);
  } catch (const DisplayLost& lost) {
    const std::string then =
        kept.path.empty() ? "with --csv answers would have been kept"
        : answered == 0   ? "nothing was answered yet: begin again once it is there"
                          : fmt::format("the answers to trials 1 to {} are in {}: continue with --resume {}",
                                        answered, kept.path, kept.path);
    throw CommandError(std::string(lost.what()) + "; " + then);
  }
}

// Of counterbalanced trials: how much their order made of it.
void print_orders(const std::vector<AnsweredTrial>& answers) {
  std::array<unsigned, 2> of{}, harder{};  // with the background first, with the stimulus first
  for (const AnsweredTrial& answer : answers)
    ++of[answer.trial.stimulus_first], harder[answer.trial.stimulus_first] += answer.harder;
  if (of[1] == 0) return;
  std::printf("\n  stimulus judged harder: %u of %u times felt after the background, %u of %u before it\n",
              harder[0], of[0], harder[1], of[1]);
}

void print_counts(const std::vector<StimulusCount>& counts) {
  std::printf("\n  stimulus (N/m)   harder   not harder   share\n");
  for (const StimulusCount& c : counts)
    std::printf("  %14g   %6u   %10u   %5.3f\n", c.stimulus_n_m, c.harder, c.not_harder, c.share_harder());
}

// False when there was no curve to print.
bool print_fit(const std::vector<StimulusCount>& counts, const FitOptions& how, double background_n_m,
               const BootstrapOptions& options) {
  const Fit fit = fit_weibull(counts, how);
  std::printf("\n  %s\n", name_of(how.method));
  if (fit.at_limit) {
    std::printf(
        "    these answers do not bound the curve: give more trials, or stimuli on both sides of the "
        "threshold\n");
    return false;
  }
  const BootstrapResult spread = bootstrap(counts, fit, how, background_n_m, options);
  const auto line = [](const char* name, double value, const Interval& interval) {
    std::printf("    %-22s %8.3f   (%.3f to %.3f)\n", name, value, interval.low, interval.high);
  };
  line("alpha (N/m)", fit.function.alpha_n_m, spread.alpha_n_m);
  line("beta", fit.function.beta, spread.beta);
  line("Weber fraction", weber_fraction(fit.function, background_n_m), spread.weber_fraction);
  std::printf("    %-22s %8.3f\n", "threshold (N/m)", threshold_n_m(fit.function));
  if (how.lapse_rate_max > 0) std::printf("    %-22s %8.3f\n", "lapse rate", fit.function.lapse_rate);
  if (spread.at_limit > 0)
    std::printf("    in %u of %u resamples the answers did not bound the curve: more trials would help\n",
                spread.at_limit, options.resamples);
  return true;
}

void run(const ExperimentArguments& arguments, const CLI::App& command) {
  require_meant(arguments, command);
  try {
    const std::vector<AnsweredTrial> answers =
        arguments.refit.empty() ? ask(arguments) : read_results_csv(arguments.refit);
    if (answers.empty()) throw CommandError("no trial was answered: there is nothing to fit");
    const std::vector<StimulusCount> counts = count_answers(answers);
    const double background_n_m = answers.front().trial.background_n_m;
    std::printf("\n%zu trials, background %g N/m, stiffness as felt: %s\n", answers.size(), background_n_m,
                answers.front().trial.condition.c_str());
    print_counts(counts);
    print_orders(answers);
    const BootstrapOptions spread{arguments.resamples, 0.95, seed_of(arguments)};
    bool fitted = print_fit(counts, {FitMethod::kLeastSquares, 0}, background_n_m, spread);
    fitted |=
        print_fit(counts, {FitMethod::kMaximumLikelihood, arguments.lapse_rate_max}, background_n_m, spread);
    if (fitted)
      std::printf("\n  in brackets: 95 %% intervals of the parametric bootstrap, %u resamples\n",
                  arguments.resamples);
  } catch (const CommandError&) {
    throw;
  } catch (const std::exception& error) {
    throw CommandError(with_flags(error.what(), {{"stimuli_n_m", "--stimuli"},
                                                 {"stimulus_n_m", "--stimuli"},
                                                 {"trials_per_stimulus", "--trials"},
                                                 {"background_n_m", "--background-n-m"},
                                                 {"lapse_rate", "--lapse-rate"},
                                                 {"lapse_rate_max", "--fit-lapse-rate-max"},
                                                 {"weber_fraction", "--weber-fraction"},
                                                 {"equality_fraction", "--equality-fraction"},
                                                 {"resamples", "--resamples"},
                                                 {"update_hz", "--update-hz"},
                                                 {"age_s", "--age-s"},
                                                 {"depth_m", "--depth-m"},
                                                 {"width_m", "--inclusion-m"},
                                                 {"edge_m", "--edge-m"}}));
  }
}

}  // namespace

void add_experiment_command(CLI::App& app) {
  const auto arguments = std::make_shared<ExperimentArguments>();
  CLI::App& command =
      *app.add_subcommand("experiment",
                          "psychophysics by constant stimuli, \"is the second harder?\": of springs or of "
                          "tissue on a service, to "
                          "a simulated observer or a person; prints Weibull fits and the Weber fraction");
  add_experiment_options(command, *arguments);
  command.callback([arguments, &command] { run(*arguments, command); });
}

}  // namespace teletact::client
