// teletact-client estimate: recorded frames -> displacement, strain, correlation and modulus on disk.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <limits>
#include <memory>

#include "client/acquire/map_output.h"
#include "client/acquire/modulus_names.h"
#include "client/acquire/recorded_frames.h"
#include "client/commands/commands.h"
#include "client/commands/modulus_options.h"
#include "client/link/channel.h"
#include "client/link/estimate_stages.h"
#include "client/recordings/recorded_set.h"
#include "client/recordings/set_output.h"

namespace teletact::client {
namespace {

struct EstimateArguments {
  std::string address, out;
  Credentials credentials;
  RecordedSetOptions set;
};

// The modulus hangs on how far the probe's stress spreads: an assumed tissue is said, not hidden.
void warn_of_assumptions(const v1::Acquisition& acquisition) {
  const TissueExtent tissue = tissue_extent(acquisition);
  if (tissue.width_assumed)
    std::fprintf(stderr,
                 "warning: --tissue-width-m is not given: the tissue is taken to end where the frame does "
                 "(%.1f mm). In wider tissue %s.\n",
                 tissue.width_m * 1e3,
                 acquisition.has_probe_force() ? "the modulus then comes out too high, up to about twofold"
                                               : "the relative modulus then ramps from top to bottom");
  if (tissue.depth_assumed)
    std::fprintf(stderr,
                 "warning: --tissue-depth-m is not given: the fixed far side is taken to lie at the end of "
                 "the frame (%.1f mm)\n",
                 tissue.depth_m * 1e3);
}

// Ctrl-C while it computes leaves nothing behind; the second that the writing takes is waited for, so that
// the folder holds all of it or nothing.
void let_writing_end() {
  std::signal(SIGINT, SIG_IGN);
  std::signal(SIGTERM, SIG_IGN);
}

EstimateCallbacks progress() {
  EstimateCallbacks callbacks;
  callbacks.response = [](const v1::EstimateResponse& response) {
    if (response.has_progress())
      std::fprintf(stderr, "%6.2f s  %s\n", response.progress().elapsed_s(),
                   stage_name(response.progress().stage()));
  };
  return callbacks;
}

double median_of(std::vector<float> log_deviation) {
  std::erase_if(log_deviation, [](float deviation) { return !std::isfinite(deviation); });
  if (log_deviation.empty()) return 0;
  const auto middle = log_deviation.begin() + static_cast<std::ptrdiff_t>(log_deviation.size() / 2);
  std::nth_element(log_deviation.begin(), middle, log_deviation.end());
  return *middle;
}

void print(const v1::Acquisition& acquisition, const EstimateOutcome& outcome) {
  const v1::EstimateSummary& summary = outcome.summary;
  std::printf(
      "%u x %u samples: quality %.2f, median correlation %.3f, valid %.1f %%, mean axial strain %.3f %%, ",
      acquisition.sample_count(), acquisition.line_count(), summary.quality(), summary.median_correlation(),
      100 * summary.valid_fraction(), 100 * summary.mean_axial_strain());
  if (summary.modulus_absolute())
    std::printf("background %s%s\n",
                background_of(summary.background_modulus_pa(), summary.youngs_modulus_log_std()).c_str(),
                tissue_extent(acquisition).width_assumed ? " (tissue as wide as the frame: assumed)" : "");
  else
    std::printf("modulus relative to its median (neither force nor pad given)\n");
  std::printf("modulus method: %s%s%s\n", name_of(summary.modulus_method()).c_str(),
              summary.modulus_model().empty() ? "" : "; ", summary.modulus_model().c_str());
}

void warn_if_stretched(const v1::EstimateSummary& summary) {
  if (summary.mean_axial_strain() > 0)
    std::fprintf(stderr,
                 "warning: the tissue stretches from pre to post (strain %+.3f %%): are the two swapped?\n",
                 100 * summary.mean_axial_strain());
}

void warn_of_doubt(double background_pa) {
  const std::string doubt = modulus_doubt(background_pa);
  if (!doubt.empty()) std::fprintf(stderr, "warning: %s\n", doubt.c_str());
}

// With what the service doubts: printed, and kept beside the maps.
void add_doubts(const FramePair& pair, v1::EstimateSummary& summary) {
  for (const std::string& doubt : pair.doubts) summary.add_warnings(doubt);
}

void run_pair(EstimateClient& client, const std::shared_ptr<grpc::Channel>& channel,
              const RecordedFrameOptions& frames, const std::string& out) {
  const FramePair pair = read_recorded_frames(frames);
  warn_of_assumptions(pair.acquisition);
  if (!pair.made.empty()) std::printf("%s\n", pair.made.c_str());
  EstimateOutcome outcome = client.estimate(pair.acquisition, pair.pre, pair.post, progress(), false);
  add_doubts(pair, outcome.summary);
  let_writing_end();
  const auto files =
      write_estimate(out, pair.acquisition, outcome, {frames.pre, frames.post, pair.made, get_info(channel)});
  print(pair.acquisition, outcome);
  for (const std::string& warning : outcome.summary.warnings())
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  warn_if_stretched(outcome.summary);
  if (outcome.summary.modulus_absolute()) warn_of_doubt(outcome.summary.background_modulus_pa());
  std::printf("%zu files in %s\n", files.size(), out.c_str());
}

std::string named(const RecordedFrameOptions& frames) {
  const auto with_frame = [](const std::filesystem::path& file, const std::string& variable,
                             const std::optional<std::size_t>& frame) {
    return file.string() + (variable.empty() ? "" : ":" + variable) +
           (frame ? "[" + std::to_string(*frame) + "]" : "");
  };
  const std::string& post = frames.post_variable;
  return with_frame(frames.pre, post.empty() ? "" : frames.variable, frames.pre_frame) + " -> " +
         with_frame(frames.post, post, frames.post_frame);
}

// What one pair has against it leaves it out; what the service has, ends all.
EstimatedPair estimate_one(EstimateClient& client, const RecordedFrameOptions& frames) {
  FramePair pair = read_recorded_frames(frames);
  EstimatedPair out{frames, pair.acquisition, pair.made, {}, {}};
  try {
    out.outcome = client.estimate(pair.acquisition, pair.pre, pair.post, progress(), false);
    add_doubts(pair, out.outcome.summary);
    warn_if_stretched(out.outcome.summary);
  } catch (const ServiceError& error) {
    if (error.code != grpc::StatusCode::INVALID_ARGUMENT &&
        error.code != grpc::StatusCode::FAILED_PRECONDITION)
      throw;
    out.refusal = error.what();
  }
  return out;
}

void print(const EstimatedPlace& place) {
  if (place.z_m) std::printf("plane at z = %.4g mm:\n", 1e3 * *place.z_m);
  std::size_t estimated = 0;
  for (std::size_t p = 0; p < place.pairs.size(); ++p) {
    const EstimatedPair& pair = place.pairs[p];
    std::printf("pair %zu, %s: ", p + 1, named(pair.frames).c_str());
    if (pair.refusal.empty()) {
      const v1::EstimateSummary& summary = pair.outcome.summary;
      const PairUse& use = place.joined.pairs[estimated++];
      std::printf("quality %.2f, mean axial strain %.3f %%, ", summary.quality(),
                  100 * summary.mean_axial_strain());
      if (place.left_out[p].empty()) std::printf("used, %.0f %% of the weight\n", 100 * use.share);
    }
    if (!place.left_out[p].empty()) std::printf("left out: %s\n", place.left_out[p].c_str());
  }
  if (place.joined.used == 0) return;
  const JoinedModulus& joined = place.joined;
  std::printf("%zu of %zu pairs used, ", joined.used, place.pairs.size());
  if (place.absolute)
    std::printf("background %s\n", background_of(place.background, median_of(joined.log_deviation)).c_str());
  else
    std::printf("modulus relative to its median\n");
  if (joined.used > 1)
    std::printf(
        "log deviation: one pair states %.3f; pairs differ by %.3f, which falls with their number; "
        "%.3f is shared and does not\n",
        joined.of_one, joined.scatter, joined.shared);
  for (const std::string& assumed : place.assumed) std::printf("assumed: %s\n", assumed.c_str());
  for (const std::string& warning : place.warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  if (place.absolute) warn_of_doubt(place.background);
}

void run_set(EstimateClient& client, const std::shared_ptr<grpc::Channel>& channel,
             const std::vector<RecordedPlace>& set, const std::string& out) {
  const FramePair first = read_recorded_frames(set.front().pairs.front());
  warn_of_assumptions(first.acquisition);
  if (!first.made.empty()) std::printf("%s\n", first.made.c_str());
  std::vector<EstimatedPlace> places;
  std::size_t used = 0;
  for (const RecordedPlace& recorded : set) {
    std::vector<EstimatedPair> pairs;
    for (const RecordedFrameOptions& frames : recorded.pairs) {
      std::fprintf(stderr, "%s\n", named(frames).c_str());
      pairs.push_back(estimate_one(client, frames));
    }
    places.push_back(join_place(recorded.z_m, std::move(pairs)));
    used += places.back().joined.used;
  }
  if (used == 0)
    throw CommandError("none of the pairs could be used; the first: " + places.front().left_out.front());
  let_writing_end();
  const auto info = get_info(channel);
  const auto files =
      set.front().z_m ? write_volume(out, places, info) : write_place(out, places.front(), info);
  for (const EstimatedPlace& place : places) print(place);
  std::printf("%zu files in %s\n", files.size(), out.c_str());
}

void run(const EstimateArguments& arguments) {
  const HeldFolder held(arguments.out);
  const std::vector<RecordedPlace> set = recorded_places(arguments.set);
  require_one_geometry(set);
  const auto channel = reach_service(arguments.address, arguments.credentials, say);
  EstimateClient client(channel);
  if (set.size() == 1 && set.front().pairs.size() == 1 && !set.front().z_m)
    run_pair(client, channel, set.front().pairs.front(), arguments.out);
  else
    run_set(client, channel, set, arguments.out);
}

// Those that every pair of frames needs, and what it must say for a modulus in Pa.
void add_usual_options(CLI::App& command, RecordedSetOptions& set) {
  RecordedFrameOptions& frames = set.common;
  command
      .add_option(
          "--pre", set.pre,
          "frame before compression: .mha, .mhd, .mat or .uff; several: one for each --post, or one for all")
      ->required();
  command
      .add_option("--post", set.post,
                  "frame after compression; several of one place: their estimates are combined")
      ->required();
  command.add_option("--center-frequency-hz", frames.center_frequency_hz, "of the transducer")->required();
  command.add_option("--sampling-frequency-hz", frames.sampling_frequency_hz,
                     "of the RF; .mha and .mat need it (default: by a .uff file's z_axis)");
  command
      .add_option(
          "--frame", frames.frame,
          "PROBE: the probe's face rests, as in a scanner's images (nearly always); LAB: the far side "
          "rests; without it nothing is estimated")
      ->transform(CLI::IsMember({"LAB", "PROBE"}, CLI::ignore_case));
  CLI::Option* force = command.add_option(
      "--force-n", set.force_n,
      "resisting force on the probe, change between pre and post, of each pair or of all; without it and "
      "--pad-thickness-m the modulus is relative, with it in Pa");
  CLI::Option* area = command.add_option("--contact-area-m2", frames.contact_area_m2,
                                         "of the probe, with --force-n; without it that is refused");
  force->needs(area);
  area->needs(force);
  command
      .add_option("--tissue-depth-m", frames.tissue_depth_m,
                  "of the fixed far side (default: of a plane the frame's depth, of a solid fitted)")
      ->check(above_zero());
  command
      .add_option(
          "--tissue-width-m", frames.tissue_width_m,
          "of the tissue, with the probe at its middle (default: of a plane the frame's width, of a solid as "
          "the strain tells)")
      ->check(above_zero());
}

void add_file_options(CLI::App& command, RecordedSetOptions& set) {
  RecordedFrameOptions& frames = set.common;
  command.option_defaults()->group("Files, and what they do not say");
  command.add_option("--z-m", set.z_m,
                     "where each pair's image plane lies across the image: planes become one volume");
  command.add_option("--variable", frames.variable,
                     ".mat: name of the RF variable; without it a .mat is refused. .uff: name of the "
                     "uff.beamformed_data; without it the only one there is");
  command.add_option("--post-variable", set.post_variable,
                     "of the frame after compression, where it is another (default: as --variable)");
  command
      .add_option("--axial-axis", frames.axial_axis,
                  ".mat: depth runs along rows or columns; without it a .mat is refused")
      ->transform(CLI::IsMember({"rows", "columns"}, CLI::ignore_case));
  command.add_option("--pre-frame", set.pre_frame,
                     "which frame of a file with several, from 0; without it such a file is refused");
  command.add_option("--post-frame", set.post_frame,
                     "which frame of a file with several, from 0; without it such a file is refused");
  command.add_option("--spacing-unit", frames.spacing_unit, ".mha: unit of the header's spacing and offset")
      ->check(CLI::IsMember({"m", "mm"}));
  command.add_option("--line-pitch-m", frames.line_pitch_m, "distance of two A-lines (default: the file's)");
  command.add_option("--sound-speed-m-s", frames.sound_speed_m_s,
                     "in the tissue, m/s (default: the .uff file's, or 1540)");
  command.add_option("--modulation-frequency-hz", frames.modulation_frequency_hz,
                     ".uff: of complex data, 0 where they were made of RF (default: the file's)");
}

void add_method_options(CLI::App& command, RecordedFrameOptions& frames) {
  command.option_defaults()->group("Estimate");
  command.add_option("--max-strain", frames.max_strain,
                     "largest strain magnitude to search for, 0.001 to 0.125");
  command.add_option("--poisson-ratio", frames.poisson_ratio, "above 0, at most 0.49999");
  add_modulus_options(command, frames.modulus_method, frames.modulus_time_limit_s);
  add_plane_option(command, frames.plane,
                   "solid; strain with --modulus-method reference-stress, direct or iterative");
  command
      .add_option("--probe-elevation-m", frames.probe_elevation_m,
                  "of solid tissue: length of the probe's face across the image plane (default: by the "
                  "contact area, or fitted)")
      ->check(above_zero());
  add_uncertainty_options(command, frames.stated);
}

}  // namespace

void add_estimate_command(CLI::App& app) {
  const auto arguments = std::make_shared<EstimateArguments>();
  CLI::App& command =
      *app.add_subcommand("estimate", "recorded RF frames -> displacement, strain, modulus on disk");
  add_service_options(command, arguments->address, arguments->credentials);
  add_usual_options(command, arguments->set);
  command.add_option("--out", arguments->out, "folder for the results")->required();
  add_file_options(command, arguments->set);
  add_method_options(command, arguments->set.common);
  command.callback([arguments] {
    if (arguments->set.common.frame.empty())
      throw UsageError(
          "give --frame PROBE (the probe's face rests, as in a scanner's images) or --frame LAB (the far "
          "side rests)");
    run(*arguments);
  });
}

}  // namespace teletact::client
