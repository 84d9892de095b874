#include "client/commands/experiment_options.h"

#include "client/commands/device_options.h"
#include "client/render/renderers.h"

namespace teletact::client {
namespace {

void add_stimulus_options(CLI::App& command, ExperimentArguments& arguments, CLI::Option* service) {
  command.option_defaults()->group("Stimulus and how it is felt");
  command
      .add_flag("--solid", arguments.tissue.solid,
                "the tissue is a solid; without it a plane, felt on a line")
      ->needs(service);
  command
      .add_option("--depth-m", arguments.tissue.depth_m,
                  "indentation at which the tissue of a --service has the stimulus's stiffness, force over "
                  "indentation")
      ->check(CLI::Range(0.001, 0.008))
      ->needs(service);
  auto* renderer =
      command
          .add_option(
              "--renderer", arguments.renderer,
              "feel through the whole chain: kalman, which gets the stiffness at --update-hz, --age-s "
              "late, or from a --service; without it stiffness is perfect, and that of a --service "
              "felt by its contact law (law)")
          ->check(CLI::IsMember(renderer_names()));
  command.add_option("--update-hz", arguments.chain.update_hz, "answers a second that --renderer is given")
      ->check(CLI::Range(1.0, 1000.0))
      ->needs(renderer)
      ->excludes(service);
  command.add_option("--age-s", arguments.chain.age_s, "of an answer as it comes to --renderer")
      ->check(CLI::Range(0.0, 0.3))
      ->needs(renderer)
      ->excludes(service);
  auto* inclusion = command
                        .add_option("--inclusion-m", arguments.tissue.place.width_m,
                                    "width of an inclusion, 30 mm to the right, that alone has the stimulus; "
                                    "without it the whole tissue has")
                        ->check(CLI::Range(0.01, 0.05));
  command
      .add_option("--edge-m", arguments.tissue.place.edge_m,
                  "of the inclusion; 4.4 times this from 10 to 90 %")
      ->check(CLI::Range(0.0005, 0.005))
      ->needs(inclusion);
}

void add_observer_options(CLI::App& command, ExperimentArguments& arguments, CLI::Option* person) {
  command.option_defaults()->group("Simulated observer");
  const auto simulated = [&](const char* name, double& value, const char* help) {
    command.add_option(name, value, help)->excludes(person);
  };
  simulated("--weber-fraction", arguments.observer.weber_fraction, "of the simulated observer");
  simulated("--lapse-rate", arguments.observer.lapse_rate, "share of trials that it answers by chance");
  simulated("--equality-fraction", arguments.observer.equality_fraction,
            "how far above the background it says harder half the time, as a fraction of it; 0 = no bias");
}

}  // namespace

void require_meant(const ExperimentArguments& arguments, const CLI::App& command) {
  require_device_options(command, arguments.device.device, arguments.device.workspace);
  const auto needs = [&](const std::vector<std::string>& options, const std::string& what) {
    for (const std::string& option : options)
      if (command.count(option) > 0) throw UsageError(option + ": " + what + ", or leave it out");
  };
  if (arguments.by_service()) {
    if (arguments.person && arguments.device.device.empty())
      throw UsageError(
          "--person: tissue on a service is felt by a device; give --device, or leave --person out for a "
          "simulated observer");
    return;
  }
  if (!arguments.person) needs({"--profile", "--counterbalanced"}, "give --person or --service");
  if (arguments.device.device.empty())
    needs({"--renderer", "--inclusion-m"}, "give --person and --device, or --service");
  if (arguments.renderer == "law")
    throw UsageError(
        "--renderer law: contact laws come from a service; give --service, or --renderer kalman");
}

void add_experiment_options(CLI::App& command, ExperimentArguments& arguments) {
  auto* service = add_optional_service_options(
      command, arguments.tissue.address, arguments.tissue.credentials,
      "the stimuli are springs of this machine. With it each is tissue of that stiffness, made as a scene of "
      "the service and felt through the whole system; the scenes are taken away at the end");
  auto* person =
      command.add_flag("--person", arguments.person,
                       "ask a person, who feels both at --device (or moves by keys and sees the force as a "
                       "bar) and types y or n; no stiffness is shown");
  command
      .add_option("--device", arguments.device.device,
                  "inverse3[:URL], plugin:FILE[,SETTINGS], simulated; without it the keyboard, which cannot "
                  "feel a --service")
      ->needs(person);
  add_device_settings(command);
  command.add_option("--background-n-m", arguments.plan.background_n_m,
                     "stiffness that each stimulus is compared with");
  command.add_option("--stimuli", arguments.plan.stimuli_n_m, "N/m; spread them about the threshold");
  command.add_option("--trials", arguments.plan.trials_per_stimulus, "of each stimulus");
  command.add_flag("--counterbalanced", arguments.plan.counterbalanced,
                   "half of each stimulus's trials have it first; without it the background always is");
  auto* seed = command.add_option(
      "--seed", arguments.seed,
      "of the order, the simulated observer and the bootstrap (default: 1; with --refit that of "
      "the answers)");
  add_stimulus_options(command, arguments, service);
  add_observer_options(command, arguments, person);
  add_workspace_options(command, arguments.device.workspace);  // no scale: a stimulus is what the hand feels
  command.option_defaults()->group(kSimulatedDevice);
  command.add_option("--profile", arguments.device.profile,
                     "its limits: premium-1.5, premium-3.0, omni or touch");
  command.option_defaults()->group("Answers and their fit");
  auto* csv = command.add_option("--csv", arguments.csv,
                                 "write every answer to this new file, as it comes; without it none is kept");
  auto* refit =
      command
          .add_option("--refit", arguments.refit,
                      "ask no questions: fit the answers of an earlier --csv; without it trials run")
          ->excludes(csv)
          ->excludes(service);
  command
      .add_option(
          "--resume", arguments.resume,
          "continue an earlier --csv where it ended, with its observer and order; give the other options as "
          "before; without it a new experiment begins")
      ->excludes(csv)
      ->excludes(refit)
      ->excludes(seed);
  command.add_option("--fit-lapse-rate-max", arguments.lapse_rate_max,
                     "fit a lapse rate too, up to this (maximum likelihood alone); 0 = no lapses");
  command.add_option("--resamples", arguments.resamples, "of the bootstrap")->check(CLI::Range(20, 100000));
}

}  // namespace teletact::client
