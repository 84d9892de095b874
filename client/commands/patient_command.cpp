// teletact-client patient: simulated RF pairs with their truth, on disk.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "client/commands/commands.h"
#include "client/files/metaimage.h"
#include "client/patient/patient.h"
#include "client/patient/rf.h"
#include "client/patient/solid_press.h"
#include "client/patient/tissue.h"
#include "client/patient/true_modulus.h"

namespace teletact::client {

namespace {

namespace fs = std::filesystem;

struct PatientOptions {
  std::string tissue_file, save_tissue_file, out, frame = "PROBE";
  std::int64_t seed = 1;  // as TOML holds it
  bool seed_given = false, unlike_model = false, windows_given = false;
  std::vector<std::string> windows{"all"};
};

constexpr double kTruthSpacing = 0.00025;  // of the truth maps

Tissue tissue_for(const PatientOptions& options) {
  if (options.unlike_model) return unlike_model(static_cast<std::uint64_t>(options.seed));
  if (options.tissue_file.empty()) return random_tissue(static_cast<std::uint64_t>(options.seed));
  Tissue tissue = read_tissue(options.tissue_file);
  if (options.seed_given) tissue.seed = static_cast<std::uint64_t>(options.seed);
  return tissue;
}

std::vector<double> windows_of(const PatientOptions& options, const Tissue& tissue) {
  std::vector<double> out;
  if (tissue.solid && !options.windows_given) return {(tissue.width_m - tissue.probe.width_m) / 2};
  if (options.windows.size() == 1 && options.windows[0] == "all") {
    for (double x = 0; x + tissue.probe.width_m <= tissue.width_m * (1 + 1e-9); x += tissue.probe.width_m)
      out.push_back(x);
    return out;
  }
  for (const std::string& word : options.windows) {
    char* end = nullptr;
    const double x = std::strtod(word.c_str(), &end);
    if (word.empty() || *end != '\0' || !(x >= 0) ||
        !(x + tissue.probe.width_m <= tissue.width_m * (1 + 1e-9)))
      throw UsageError("--window-x-m " + word + ": must be 'all' or positions from 0 to " +
                       std::to_string(tissue.width_m - tissue.probe.width_m) + " m");
    out.push_back(x);
  }
  return out;
}

MetaImage rf_image(const RfGeometry& g, const std::vector<std::int16_t>& samples) {
  return MetaImage::of<std::int16_t>({g.sample_count, g.line_count}, {g.sample_pitch_m, g.line_pitch_m},
                                     {0, g.first_line_x_m}, samples);
}

// Nodes of the truth maps over one window: depth fastest, as the RF.
struct TruthGrid {
  std::size_t ny, nx;
  double x0;
  double x(std::size_t i) const { return x0 + kTruthSpacing * static_cast<double>(i); }
  double y(std::size_t j) const { return kTruthSpacing * static_cast<double>(j); }
};

void write_truth(const fs::path& stem, const Tissue& tissue, const ProbeState& state, RfFrame frame) {
  const TrueModulus true_modulus(tissue);
  const TruthGrid grid{static_cast<std::size_t>(std::lround(tissue.imaged_depth_m() / kTruthSpacing)) + 1,
                       static_cast<std::size_t>(std::lround(state.width_m / kTruthSpacing)) + 1,
                       state.window_x_m};
  std::vector<double> u;
  std::vector<float> modulus;
  for (std::size_t i = 0; i < grid.nx; ++i)
    for (std::size_t j = 0; j < grid.ny; ++j) {
      const auto v = state.field->at(grid.x(i), grid.y(j));
      const auto rest =
          frame == RfFrame::kProbe ? state.motion(grid.x(i), grid.y(j)) : DisplacementField::Vector{};
      u.push_back(v.y - rest.y);
      u.push_back(v.x - rest.x);
      modulus.push_back(static_cast<float>(true_modulus(grid.x(i), grid.y(j))));
    }
  const std::vector<std::size_t> size{grid.ny, grid.nx};
  const std::vector<double> spacing{kTruthSpacing, kTruthSpacing}, origin{0, grid.x0};
  write_metaimage(stem.string() + "_truth_displacement.mha",
                  MetaImage::of<double>(size, spacing, origin, u, 2));
  write_metaimage(stem.string() + "_truth_modulus.mha", MetaImage::of<float>(size, spacing, origin, modulus));
}

nlohmann::json description_of(const Solid& s) {
  const nlohmann::json friction = std::isinf(s.friction) ? nlohmann::json("inf") : nlohmann::json(s.friction);
  return {{"elevational_width_m", s.elevational_width_m},
          {"support", name_of(s.support)},
          {"bed_depth_m", s.bed_depth_m},
          {"bed_modulus_pa", s.bed_modulus_pa},
          {"friction", friction},
          {"uneven", s.uneven},
          {"preload_m", s.preload_m},
          {"lean_m", s.lean_m},
          {"capsule_m", s.capsule_m},
          {"capsule_contrast", s.capsule_contrast},
          {"bottom_contrast", s.bottom_contrast},
          {"texture", s.texture},
          {"texture_length_m", s.texture_length_m}};
}

nlohmann::json description(const Tissue& t, const std::string& frame) {
  nlohmann::json inclusions = nlohmann::json::array();
  for (const Inclusion& i : t.inclusions) {
    inclusions.push_back(
        {{"position_m", {i.x_m, i.y_m}}, {"diameter_m", i.diameter_m}, {"contrast", i.contrast}});
    if (!t.solid) continue;
    inclusions.back()["position_m"].push_back(i.z_m);
    inclusions.back()["shape"] = i.sphere ? "sphere" : "cylinder";
  }
  const Ultrasound& u = t.ultrasound;
  nlohmann::json out{{"seed", t.seed},
                     {"width_m", t.width_m},
                     {"depth_m", t.depth_m},
                     {"youngs_modulus_pa", t.youngs_modulus_pa},
                     {"poisson_ratio", t.poisson_ratio},
                     {"thickness_m", t.thickness_m},
                     {"inclusions", inclusions},
                     {"displacement_frame", frame},
                     {"center_frequency_hz", u.center_frequency_hz},
                     {"sampling_frequency_hz", u.sampling_frequency_hz},
                     {"sound_speed_m_s", u.sound_speed_m_s},
                     {"line_pitch_m", t.probe.line_pitch_m()},
                     {"first_sample_depth_m", 0.0},
                     {"bandwidth", u.bandwidth},
                     {"f_number", u.f_number},
                     {"snr_db", u.snr_db},
                     {"correlation", u.correlation},
                     {"imaged_depth_m", t.imaged_depth_m()},
                     {"elevation_beam_m", u.elevation_beam_m},
                     {"focus_m", u.focus_m},
                     {"beam_growth", u.beam_growth},
                     {"attenuation_db_cm_mhz", u.attenuation_db_cm_mhz},
                     {"probe_width_m", t.probe.width_m},
                     {"probe_elevation_m", t.probe.elevation_m},
                     {"force_gain_error", t.probe.force_gain_error},
                     {"force_zero_n", t.probe.force_zero_n},
                     {"windows", nlohmann::json::array()}};
  if (t.solid) out["solid"] = description_of(*t.solid);
  return out;
}

// Either patient's, under the probe.
class Pressed {
 public:
  explicit Pressed(const Tissue& tissue) : tissue_(tissue) {
    if (!tissue.solid) plane_.emplace(tissue);
  }
  const Tissue& tissue() const { return tissue_; }
  ProbeState press(double window_x_m) const {
    const double compression_m = tissue_.probe.compression_m;
    return plane_ ? plane_->press(window_x_m, compression_m)
                  : press_solid(tissue_, window_x_m, compression_m);
  }

 private:
  Tissue tissue_;
  std::optional<Patient> plane_;
};

// One window: RF pair, truth maps, its entry of truth.json.
nlohmann::json write_window(const fs::path& out, const Pressed& patient, double window_x_m, RfFrame frame,
                            std::size_t index) {
  const Tissue& tissue = patient.tissue();
  const ProbeState state = patient.press(window_x_m);
  const std::uint64_t seed =
      tissue.seed * 1000003u + static_cast<std::uint64_t>(std::llround(window_x_m * 1e6));
  const RfPair pair = with_noise(simulate_rf(tissue, state, frame, seed), seed + 1);
  const std::string stem = "window" + std::to_string(index);
  write_metaimage(out / (stem + "_pre.mha"), rf_image(pair.geometry, pair.pre));
  write_metaimage(out / (stem + "_post.mha"), rf_image(pair.geometry, pair.post));
  write_truth(out / stem, tissue, state, frame);
  const double sensed = sensed_force(tissue.probe, state.force_n, seed + 2);
  std::printf("window %zu  x %.3f m  force %.4f N\n", index, window_x_m, sensed);
  return {{"window_x_m", window_x_m},
          {"width_m", state.width_m},
          {"compression_m", state.compression_m},
          {"tilt", state.tilt},
          {"force_n", sensed},
          {"true_force_n", state.force_n},
          {"contact_area_m2", state.contact_area_m2},
          {"pre", stem + "_pre.mha"},
          {"post", stem + "_post.mha"},
          {"truth_displacement", stem + "_truth_displacement.mha"},
          {"truth_modulus", stem + "_truth_modulus.mha"}};
}

void run_patient(const PatientOptions& options) {
  try {
    const Tissue tissue = tissue_for(options);
    const auto windows = windows_of(options, tissue);
    const HeldFolder held(options.out);
    if (!options.save_tissue_file.empty()) write_tissue(options.save_tissue_file, tissue);
    const Pressed patient(tissue);
    nlohmann::json truth = description(tissue, options.frame);
    const RfFrame frame = options.frame == "LAB" ? RfFrame::kLab : RfFrame::kProbe;
    for (std::size_t k = 0; k < windows.size(); ++k)
      truth["windows"].push_back(write_window(options.out, patient, windows[k], frame, k));
    write_file(fs::path(options.out) / "truth.json", truth.dump(2) + "\n");
  } catch (const TissueError& error) {
    throw CommandError(error.what());
  } catch (const FileError& error) {
    throw CommandError(error.what());
  }
}

}  // namespace

void add_patient_command(CLI::App& app) {
  auto options = std::make_shared<PatientOptions>();
  CLI::App* command = app.add_subcommand("patient", "simulated RF pairs of a tissue, with their truth");
  CLI::Option* file = command->add_option("--tissue", options->tissue_file,
                                          "tissue file (TOML); without it a random patient");
  command
      ->add_flag("--unlike-model", options->unlike_model,
                 "a solid that violates every assumption of an estimate, drawn by --seed")
      ->excludes(file);
  command->add_option("--seed", options->seed, "random patient, or fresh scatterers and noise for --tissue")
      ->check(CLI::Range(std::int64_t{0}, std::numeric_limits<std::int64_t>::max()));
  command->add_option("--save-tissue", options->save_tissue_file,
                      "write the tissue as a file (default: not kept)");
  command
      ->add_option("--window-x-m", options->windows,
                   "left borders of the windows (m), or all; of a solid the middle unless given")
      ->expected(1, 64);
  command->add_option("--frame", options->frame, "frame of the displacement")
      ->transform(CLI::IsMember({"PROBE", "LAB"}, CLI::ignore_case));
  command->add_option("--out", options->out, "folder for the .mha pairs, truth maps and truth.json")
      ->required();
  retire(*command, "--write-tissue", "give --save-tissue");
  command->callback([options, command] {
    options->seed_given = command->count("--seed") > 0;
    options->windows_given = command->count("--window-x-m") > 0;
    run_patient(*options);
  });
}

}  // namespace teletact::client
