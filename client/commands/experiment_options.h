// What `experiment` is told.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>

#include "client/experiment/observer.h"
#include "client/experiment/spring_display.h"
#include "client/session/devices.h"
#include "client/stimuli/stimulus_scenes.h"

namespace teletact::client {

struct ExperimentArguments {
  ExperimentPlan plan;
  ObserverDescription observer;
  bool person = false;
  DeviceChoice device = {.device = ""};  // empty: the keyboard
  std::string renderer;                  // empty: perfect stiffness, of a service its law
  SpringChain chain;                     // of springs that are felt by one
  TissueOptions tissue;                  // no address: springs, at its place
  std::optional<std::uint64_t> seed;     // of --seed
  std::string csv, refit, resume;
  double lapse_rate_max = 0;
  unsigned resamples = 1000;
  bool by_service() const { return !tissue.address.empty(); }
};

void add_experiment_options(CLI::App&, ExperimentArguments&);

// Throws CommandError for one that says nothing beside the others.
void require_meant(const ExperimentArguments&, const CLI::App&);

}  // namespace teletact::client
