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
#include "client/commands/workspace_options.h"
#include "client/experiment/bootstrap.h"
#include "client/experiment/endable_input.h"
#include "client/experiment/observer.h"
#include "client/experiment/person.h"
#include "client/experiment/results_csv.h"
#include "client/experiment/spring_display.h"
#include "client/render/renderers.h"
#include "client/servo/ending.h"
#include "client/session/devices.h"
#include "client/stimuli/tissue_display.h"

namespace teletact::client {
namespace {

struct Arguments {
  ExperimentPlan plan;
  ObserverDescription observer;
  bool person = false;
  DeviceChoice device = {.device = ""};  // empty: the keyboard
  SpringChain chain = {.renderer = ""};  // empty: perfect stiffness, of a service its law
  TissueOptions tissue;                  // no address: springs, at its place
  std::optional<std::uint64_t> seed;     // of --seed
  std::string csv, refit, resume;
  double lapse_rate_most = 0;
  unsigned resamples = 1000;
};

// As given, as the answers were made with, or 1.
std::uint64_t seed_of(const Arguments& arguments) {
  if (arguments.seed) return *arguments.seed;
  constexpr std::uint64_t kUsual = 1;
  if (arguments.resume.empty())
    return arguments.refit.empty() ? kUsual : seed_of_results_csv(arguments.refit).value_or(kUsual);
  if (const auto seed = seed_of_results_csv(arguments.resume)) return *seed;
  throw CommandError(arguments.resume +
                     " cannot be read, or states no seed: the order of its trials is not known");
}

bool by_service(const Arguments& arguments) {
  return !arguments.tissue.address.empty();
}

std::string touch_renderer(const Arguments& arguments) {
  return arguments.chain.renderer.empty() ? "law" : arguments.chain.renderer;
}

std::string remark_of(const Arguments& arguments) {
  const std::string who =
      arguments.person
          ? "a person at " + (arguments.device.device.empty() ? "the keyboard" : arguments.device.device)
          : fmt::format("simulated, Weber fraction {}, lapse rate {}, equality {}",
                        arguments.observer.weber_fraction, arguments.observer.lapse_rate,
                        arguments.observer.equality_fraction);
  return fmt::format("teletact experiment: seed {}, {} trials of each stimulus; observer: {}",
                     seed_of(arguments), arguments.plan.trials_per_stimulus, who);
}

std::optional<SpringChain> chain_of(const Arguments& arguments) {
  if (arguments.chain.renderer.empty()) return std::nullopt;
  return arguments.chain;
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

Apparatus springs(const Arguments& arguments) {
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

Apparatus tissues(const Arguments& arguments, const std::atomic<bool>& stop) {
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

Kept kept_by(const Arguments& arguments, const std::vector<Trial>& trials) {
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
std::vector<AnsweredTrial> ask(const Arguments& arguments) {
  Random random(seed_of(arguments));
  ExperimentPlan plan = arguments.plan;
  plan.condition = by_service(arguments) ? condition_of(touch_renderer(arguments), arguments.tissue)
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
    const Apparatus apparatus = by_service(arguments) ? tissues(arguments, end) : springs(arguments);
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
                          : fmt::format("the answers to trials 1 to {} are in {}: go on with --resume {}",
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
  if (how.lapse_rate_most > 0) std::printf("    %-22s %8.3f\n", "lapse rate", fit.function.lapse_rate);
  if (spread.at_limit > 0)
    std::printf("    in %u of %u resamples the answers did not bound the curve: more trials would help\n",
                spread.at_limit, options.resamples);
  return true;
}

// Options that say nothing here.
void require_meant(const Arguments& arguments, const CLI::App& command) {
  const auto needs = [&](const std::vector<std::string>& options, const std::string& what) {
    for (const std::string& option : options)
      if (command.count(option) > 0) throw CommandError(option + ": " + what + ", or leave it out");
  };
  if (by_service(arguments)) {
    refuse_beside(command, {"--update-hz", "--age-s"}, "answers come as the --service sends them");
    if (arguments.person && arguments.device.device.empty())
      throw CommandError(
          "--person: tissue on a service is felt by a device; give --device, or leave --person out for a "
          "simulated observer");
    return;
  }
  if (!arguments.person) needs({"--profile", "--counterbalanced"}, "give --person or --service");
  if (arguments.device.device.empty())
    needs({"--renderer", "--inclusion-m"}, "give --person and --device, or --service");
  if (arguments.chain.renderer == "law")
    throw CommandError("--renderer law: contact laws come from a service; give --service, or another one");
}

void run(const Arguments& arguments, const CLI::App& command) {
  require_meant(arguments, command);
  if (is_real(arguments.device.device))
    refuse_beside(command, {"--profile"}, "--device " + arguments.device.device + " states its own limits");
  else
    refuse_beside(command, {"--axes", "--rotation-deg", "--clutch-button"}, "there is no real --device");
  require_workspace(arguments.device.workspace);
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
        print_fit(counts, {FitMethod::kMaximumLikelihood, arguments.lapse_rate_most}, background_n_m, spread);
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
                                                 {"lapse_rate_most", "--fit-lapse-rate-most"},
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

void add_service(CLI::App& command, Arguments& arguments) {
  auto* service = add_optional_service_options(
      command, arguments.tissue.address, arguments.tissue.credentials,
      "the stimuli are springs of this machine. With it each is tissue of that stiffness, made as a scene of "
      "the service and felt through the whole system; the scenes are taken away at the end");
  command
      .add_flag("--solid", arguments.tissue.solid,
                "the tissue is a solid; without it a plane, felt on a line")
      ->needs(service);
  command
      .add_option("--depth-m", arguments.tissue.depth_m,
                  "indentation at which the tissue of a --service has the stimulus's stiffness, force over "
                  "indentation")
      ->check(CLI::Range(0.001, 0.008))
      ->capture_default_str()
      ->needs(service);
}

void add_observer_options(CLI::App& command, Arguments& arguments) {
  auto* person =
      command.add_flag("--person", arguments.person,
                       "ask a person, who feels both at --device (or moves by keys and sees the force as a "
                       "bar) and types y or n; no stiffness is shown");
  command
      .add_option("--device", arguments.device.device,
                  "of the person: inverse3[:URL], plugin:FILE[,SETTINGS], simulated; without it the "
                  "keyboard, by which "
                  "--service is not felt")
      ->needs(person);
  command.add_option("--profile", arguments.device.profile, "of a simulated device");
  command.add_flag("--counterbalanced", arguments.plan.counterbalanced,
                   "half of each stimulus's trials have it first; without it the background always is");
  auto* renderer =
      command
          .add_option("--renderer", arguments.chain.renderer,
                      "feel through the whole chain: kalman, kalman-force, interpolate or hold, told of the "
                      "stiffness at --update-hz, --age-s late, or by a --service; without it stiffness is "
                      "perfect, and that of a --service felt by its contact law (law)")
          ->check(CLI::IsMember(touch_renderer_names()));
  command.add_option("--update-hz", arguments.chain.update_hz, "answers a second that --renderer is given")
      ->check(CLI::Range(1.0, 1000.0))
      ->capture_default_str()
      ->needs(renderer);
  command.add_option("--age-s", arguments.chain.age_s, "of an answer as it comes to --renderer")
      ->check(CLI::Range(0.0, 0.3))
      ->capture_default_str()
      ->needs(renderer);
  auto* inclusion = command
                        .add_option("--inclusion-m", arguments.tissue.place.width_m,
                                    "width of an inclusion, 30 mm to the right, that alone has the stimulus; "
                                    "without it it is felt everywhere")
                        ->check(CLI::Range(0.01, 0.05));
  command
      .add_option("--edge-m", arguments.tissue.place.edge_m,
                  "of the inclusion; 4.4 times this from 10 to 90 %")
      ->check(CLI::Range(0.0005, 0.005))
      ->capture_default_str()
      ->needs(inclusion);
  const auto simulated = [&](const char* name, double& value, const char* help) {
    command.add_option(name, value, help)->capture_default_str()->excludes(person);
  };
  simulated("--weber-fraction", arguments.observer.weber_fraction, "of the simulated observer");
  simulated("--lapse-rate", arguments.observer.lapse_rate, "share of trials that it answers by chance");
  simulated("--equality-fraction", arguments.observer.equality_fraction,
            "how far above the background it says harder half the time, as a fraction of it; 0 = no bias");
}

}  // namespace

void add_experiment_command(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *app.add_subcommand(
      "experiment",
      "psychophysics by constant stimuli: \"is the second harder?\", with perfect stiffness (nothing between "
      "the stated stimulus and the observer), by a person at a device through the whole chain (--renderer), "
      "or of tissue on a service (--service); prints Weibull fits and the Weber fraction");
  add_service(command, *arguments);
  add_observer_options(command, *arguments);
  add_workspace_options(command, arguments->device.workspace);  // no scale: a stimulus is what the hand feels
  command.add_option("--background-n-m", arguments->plan.background_n_m, "that each stimulus is felt beside")
      ->capture_default_str();
  command.add_option("--stimuli", arguments->plan.stimuli_n_m, "N/m; spread them about the threshold")
      ->capture_default_str();
  command.add_option("--trials", arguments->plan.trials_per_stimulus, "of each stimulus")
      ->capture_default_str();
  auto* seed = command.add_option(
      "--seed", arguments->seed,
      "of the order, the simulated observer and the bootstrap (default: 1; with --refit that of "
      "the answers)");
  auto* csv = command.add_option("--csv", arguments->csv,
                                 "write every answer to this new file, as it comes; without it none is kept");
  auto* refit =
      command
          .add_option("--refit", arguments->refit,
                      "ask nobody: fit the answers of an earlier --csv; without it they are asked for")
          ->excludes(csv)
          ->excludes("--service");
  command
      .add_option(
          "--resume", arguments->resume,
          "go on with the observer of an earlier --csv where it ended, in its order; the other options "
          "as they were; without it a new one begins")
      ->excludes(csv)
      ->excludes(refit)
      ->excludes(seed);
  command
      .add_option("--fit-lapse-rate-most", arguments->lapse_rate_most,
                  "fit a lapse rate too, up to this (maximum likelihood alone); 0 = no lapses")
      ->capture_default_str();
  command.add_option("--resamples", arguments->resamples, "of the bootstrap")
      ->check(CLI::Range(20, 100000))
      ->capture_default_str();
  command.callback([arguments, &command] { run(*arguments, command); });
}

}  // namespace teletact::client
