// The parts of the elastography chart (suite elastography.cpp): what is run, measured, promised and drawn.
// All speak through the suite's JSON, so that targets and pictures can be made again from a file. SI units.
//
//   kernels_m: axial lengths of the strain kernel; edge_m: the edge width at which methods are compared
//   conditions: [{factors: ["middle" | "strain" | "snr" | ...], case: {strain, snr_db, ...}, bound_m,
//   filter_snre, companded_filter_snre,
//     calibration: {inside, outside: {seeds: [deviation of the default's standardised errors], rms, low, high
//     (95 % interval)}}, methods: [{method, ours, edges: [{axial_m, lateral_m} per kernel], seeds: [{seconds,
//     axial_rmse_m, ...,
//       snre: [per kernel], cnre: [...], strain_rmse: [...]}]}]}]
//   rigid: {bound_m, methods: [{method, ours, phases: [{shift_m, rmse_m, bias_m}]}]}
//   images: {grid, truth, methods: [{method, strain}]}: of the middle's first seed
//   modulus: {background_pa, cases: [{contrast, diameter_m, methods: [{method, ours, image, seeds: [{seconds,
//     contrast, dice, background_pa, ...} | {failed}]}]}]}
//   stages: {plane: {direct, iterative: {displacement_s: {p50, ...}, ...}}, devices: [{device, bytes_s,
//   flops_s, kernels:
//   [{kernel,
//     seconds, launches, bytes, flops, of_limit}]}]}
#pragma once

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/peers/tracker.h"
#include "bench/phantoms/phantom.h"
#include "bench/suite.h"

namespace teletact::bench {

constexpr double kKernelLateralM = 2.0e-3;  // of the strain, for all
// Axial lengths of the strain kernel, odd numbers of nodes.
std::vector<double> strain_kernels_m();
constexpr double kEdgeM = 2.0e-3;  // the edge width at which SNRe and CNRe are compared

// A phantom and the curves that it lies on: "middle", "strain", "snr", "correlation", "contrast", "diameter".
struct Condition {
  PhantomCase of;
  std::vector<std::string> factors;
};
std::vector<Condition> chart_conditions(bool quick);

// Ours and others', ready to track; all search as far as max_strain asks for.
std::vector<std::unique_ptr<Tracker>> make_trackers(const std::shared_ptr<service::Device>&,
                                                    double max_strain);
// What all are told to search for above the product's default (5 %) of compression, the others at it too:
// tissue strains by more at places, which their search does not allow for and ours does.
constexpr double kWideStrain = 0.10;

// conditions and images; `wide` search as above.
nlohmann::json measure_conditions(const std::vector<std::unique_ptr<Tracker>>&,
                                  const std::vector<std::unique_ptr<Tracker>>& wide, bool quick,
                                  nlohmann::json& images);
// Acceptance 1: rigid shifts in parts of a sample.
nlohmann::json measure_rigid(const std::vector<std::unique_ptr<Tracker>>&, bool quick);

// Acceptance 4.
nlohmann::json measure_modulus(const std::shared_ptr<service::Device>&, bool quick);
void add_modulus_targets(const nlohmann::json& modulus, std::vector<Target>&);
void draw_modulus(const nlohmann::json& result, const std::filesystem::path& folder);

// Acceptance 6.
nlohmann::json measure_stages(const std::shared_ptr<service::Device>&, bool quick);
void print_stages(const nlohmann::json& stages);

// Figures of a seed by the edge width instead of by the kernel: the kernels on both sides of `edge_m`, linear
// in the logarithm; NaN where the method does not come so sharp or so smooth with these kernels.
double at_edge(const nlohmann::json& method, const nlohmann::json& seed, const char* figure, double edge_m);
// One figure of every seed, NaN left out.
std::vector<double> over_seeds(const nlohmann::json& method, const char* figure);
// SNRe or CNRe at edge_m of every seed; NaN stays, so that seeds of two methods pair.
std::vector<double> matched_over_seeds(const nlohmann::json& method, const char* figure, double edge_m);
double number(const nlohmann::json&);  // NaN for null
bool on_curve(const nlohmann::json& condition, const std::string& factor);

// Acceptance lines that `result` holds figures for.
std::vector<Target> elastography_targets(const nlohmann::json& result);
// Where each method stops working along each factor: one line each.
nlohmann::json failures(const nlohmann::json& result);
// Conditions at which a method has no SNRe at the edge width of the comparison.
nlohmann::json without_figure(const nlohmann::json& result);

struct NamedImage {
  std::string title;
  nlohmann::json values;  // of every node, null for none
};
// In rows of three, x and y in mm; values times `scale`, `settings` of gnuplot.
void draw_images(const nlohmann::json& grid, const std::vector<NamedImage>&, double scale,
                 const std::string& settings, const std::filesystem::path& file);

void draw_elastography(const nlohmann::json& result, const std::string& folder);

}  // namespace teletact::bench
