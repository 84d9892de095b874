#include "client/commands/modulus_options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "client/acquire/modulus_names.h"
#include "client/commands/commands.h"

namespace teletact::client {
namespace {

constexpr const char* kSurface = "Surface of solid tissue";

template <class Set, class Value>
CLI::Option* add_named(CLI::App& command, const std::string& flag, const Set& set,
                       const std::map<std::string, Value>& names, const std::string& help) {
  std::vector<std::string> allowed;
  allowed.reserve(names.size());
  for (const auto& named : names) allowed.push_back(named.first);
  return command
      .add_option_function<std::string>(
          flag, [set, &names](const std::string& name) { set(names.at(name)); }, help)
      ->transform(CLI::IsMember(allowed, CLI::ignore_case));
}

// Of ProbeForce and Acquisition; the option's name is the field's.
struct Uncertain {
  std::string field;
  bool of_force;
  const char* help;
};
const std::vector<Uncertain>& uncertain() {
  static const std::vector<Uncertain> all{
      {"force_std_n", true, "standard deviation of the force: the sensor's noise (default: 3 % of it)"},
      {"force_zero_n", true, "what the sensor shows without a load, change from pre to post (default: 0)"},
      {"force_zero_std_n", true, "by how much its zero drifts (default: within --force-std-n)"},
      {"force_gain", true, "what the sensor shows of each newton (default: 1)"},
      {"force_gain_std", true, "of its gain (default: within --force-std-n)"},
      {"contact_area_std_m2", true, "of the contact area (default: 5 % of it)"},
      {"probe_elevation_std_m", false,
       "of the face's length across the image plane (default: the service's)"},
      {"tissue_depth_std_m", false, "of the tissue's depth (default: of a solid the service's, else none)"},
      {"tissue_width_std_m", false, "of the tissue's width (default: of a solid the service's, else none)"},
      {"poisson_ratio_std", false, "of the Poisson ratio, at most 0.1 (default: 0.01)"},
      {"sound_speed_std_m_s", false, "of the speed of sound (default: 1.5 % of it)"},
      {"preload_m", false, "by how much the probe was pressed in before the pre frame (default: 0)"},
      {"preload_std_m", false, "of --preload-m (default: 0)"},
      {"capsule_thickness_m", false, "of --surface capsule, 0.01 to 3 mm; without it that is refused"},
      {"capsule_ratio", false,
       "of --surface capsule: its modulus over that of the tissue below; without it that is refused"},
      {"capsule_thickness_std_m", false, "of --capsule-thickness-m (default: 25 % of it)"},
      {"capsule_ratio_std", false, "of --capsule-ratio (default: 30 % of it)"},
      {"pad_thickness_m", false,
       "of a stand-off pad of known modulus, 7 mm or more; without it there is none"},
      {"pad_youngs_modulus_pa", false,
       "of --pad-thickness-m: the scale of the modulus where --force-n is not known; without it a pad is "
       "refused"},
      {"pad_thickness_std_m", false, "of --pad-thickness-m (default: 5 % of it)"},
      {"pad_youngs_modulus_std_pa", false, "of --pad-youngs-modulus-pa (default: 5 % of it)"}};
  return all;
}

}  // namespace

void add_uncertainty_options(CLI::App& command, v1::Acquisition& stated) {
  command.option_defaults()->group("How uncertain that is");
  const bool relative = command.get_option_no_throw("--force-n") != nullptr;
  add_named(
      command, "--surface", [&stated](v1::SurfaceKind kind) { stated.set_surface(kind); }, surface_kinds(),
      "its topmost 3 mm: unknown, but alike along the face; bare: as what is below; a capsule; uneven: it "
      "changes within 5 mm (default: unknown)")
      ->group(kSurface);
  for (const Uncertain& u : uncertain()) {
    const bool of_pad = u.field.starts_with("pad_");
    if (of_pad && !relative) continue;
    std::string flag = "--" + u.field;
    std::ranges::replace(flag, '_', '-');
    const auto set = [&stated, &u](double value) {
      google::protobuf::Message* message =
          u.of_force ? static_cast<google::protobuf::Message*>(stated.mutable_probe_force()) : &stated;
      message->GetReflection()->SetDouble(message, message->GetDescriptor()->FindFieldByName(u.field), value);
    };
    CLI::Option* option = command.add_option_function<double>(flag, set, u.help);
    if (u.field != "force_zero_n") option->check(above_zero());
    if (u.field.starts_with("capsule_"))
      option->group(kSurface)->needs("--surface");
    else if (of_pad)
      option->group("Pad on the probe");
    else if (u.field.find("_std") == std::string::npos)
      option->group("Force sensor and preload");
    if (u.of_force && relative) option->needs("--force-n");
  }
}

void add_plane_option(CLI::App& command, v1::PlaneCondition& plane, const std::string& usual) {
  add_named(
      command, "--plane", [&plane](v1::PlaneCondition named) { plane = named; }, plane_conditions(),
      "solid: tissue that continues around a narrow probe, ends beside it, or is as wide as the probe, as "
      "the strain shows; strain: the tissue's neighbours hold it; stress: a thin slice (default: " +
          usual + ")");
}

void add_modulus_options(CLI::App& command, v1::ModulusMethod& method, double& time_limit_s) {
  add_named(
      command, "--modulus-method", [&method](v1::ModulusMethod named) { method = named; }, modulus_methods(),
      "reference-stress, direct or iterative (default: the service chooses by what the force needs and "
      "the time leaves); a solid has its own");
  command
      .add_option(
          "--modulus-time-limit-s", time_limit_s,
          "longest work on the modulus, predicted in seconds of a typical core; a service allows at most "
          "60 s unless its limits say otherwise")
      ->check(above_zero())
      ->default_str(time_limit_s > 0 ? std::to_string(std::lround(time_limit_s)) : "what the finger leaves");
}

}  // namespace teletact::client
