// teletact-bench stability: where a touch stays stable (T5), one part each: figures, targets and pictures.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/suite.h"

namespace teletact::bench {

struct StabilityPart {
  const char* name;
  nlohmann::json (*measure)(bool quick, std::vector<Target>& targets);
  void (*draw)(const nlohmann::json& figures, const std::string& folder);  // null: nothing to draw
};

StabilityPart stability_passivity();  // hold's passivity border, by its worst imposed motion (T5.2)
StabilityPart stability_promise();    // Kalman with tangent where a held 50 Hz force is active
StabilityPart stability_lift();       // presses to the largest force, lifts and taps, by every renderer
StabilityPart stability_chart();      // stable, limit cycle, unstable, by every renderer
StabilityPart stability_position();   // displays that command a position, through the virtual coupling
StabilityPart stability_fuzz();       // any stream of answers

}  // namespace teletact::bench
