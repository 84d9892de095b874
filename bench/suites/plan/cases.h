// Touches that models are known to fail at (T9.6): what is off, what is stated, and what is said.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "service/device/device.h"

namespace teletact::bench {

// Errors and what is stated of them (half of the 95 % interval, without finite strain) are over the force.
struct HardCase {
  std::string name;
  double true_n = 0;                           // axial; NaN: not known
  double felt_n = 0;                           // as a session answers that asks for nothing
  double error = 0, stated = 0;                // of that
  std::string by{};                            // the model that answered
  double shares_error = 0, shares_stated = 0;  // of log-weighted shares, whatever answered
  std::string said{};                          // status and warning of the answer; empty: none
  // Beyond what is stated, and nothing is said.
  bool missed() const { return !(error <= stated) && said.empty(); }
};

// By a session on what is given of the tissue; `each` sees one after the other. `quick`: the first two.
std::vector<HardCase> hard_cases(const std::shared_ptr<service::Device>&, bool quick,
                                 const std::function<void(const HardCase&)>& each);

// How often the model changes in ten minutes, after the first time, while a finger goes to and fro over the
// border where shares are no longer good enough.
std::size_t changes_on_a_border(const std::shared_ptr<service::Device>&);

}  // namespace teletact::bench
