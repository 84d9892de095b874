// The cases of `warnings`: windows that provoke a warning of an estimate, at a stated level, and windows that
// do not. The displacement is given, from the patient's own finite elements with noise: tracking is not what
// is asked.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bench/phantoms/drawn_window.h"
#include "bench/phantoms/given_measurement.h"
#include "service/imaging/modulus/modulus.h"

namespace teletact::bench {

// A pair as it comes to the modulus.
struct WarnedWindow {
  GivenDisplacement displacement;
  std::shared_ptr<const DrawnWindow> plane;  // has what is measured itself; else `displacement`
  std::optional<service::RfFrame> frame;     // what is asked is whether this is RF: nothing is estimated
  service::TissueExtent tissue;
  std::optional<service::ProbeForce> force;
  service::KnownModulus known;
  service::ModulusBudget budget;
  service::ModulusKind kind = service::ModulusKind::kSolid;
  double background_pa = 10e3;
};

// What windows of one kind say of a warning.
struct Claim {
  Claim(service::ModulusFlag flag, bool provoked) : Claim(service::name_of(flag), provoked) {}
  Claim(std::string warning, bool provoked) : warning(std::move(warning)), provoked(provoked) {}
  std::string warning;  // its name
  bool provoked;
};

struct WarningRow {
  std::string name;  // with its level
  std::vector<Claim> claims;
  std::function<WarnedWindow(std::uint64_t seed)> window;
};

std::vector<WarningRow> warning_rows(const service::Queue&);

}  // namespace teletact::bench
