// teletact-client report: recordings, and the true tissue where it is known -> summary.json and pictures.
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "client/commands/commands.h"
#include "client/files/file_io.h"
#include "client/report/pictures.h"
#include "client/report/summary.h"

namespace teletact::client {
namespace {

constexpr int kPromisesMissed = 2;  // exit code, beside 1 for a report that could not be made

struct ReportArguments {
  std::string tissue, touch_record, acquire_record, out;
};

// Beside the true tissue; `draw`: what its own pictures take.
nlohmann::json judged(const ReportArguments& arguments, const TouchRecord& touch,
                      std::function<void()>& draw) {
  const AcquireRecord acquire = read_acquire_record(arguments.acquire_record);
  if (const std::string doubt = session_mismatch(touch, acquire); !doubt.empty())
    std::fprintf(stderr, "warning: %s\n", doubt.c_str());
  const Tissue tissue = read_tissue(arguments.tissue);
  const ModulusGrid modulus = measured_modulus(acquire);
  const InclusionReport inclusions = find_inclusions(modulus, tissue.inclusions);
  std::fprintf(stderr, "solving the true tissue's forces along the path\n");
  const ForceError force = force_error(Patient(tissue), touch);
  draw = [=, out = std::filesystem::path(arguments.out)] {
    draw_modulus(out / "modulus.png", tissue, modulus);
    draw_force(out / "force.png", force.samples);
  };
  return summarise(tissue, touch, acquire, force, inclusions, TELETACT_VERSION);
}

bool run(const ReportArguments& arguments) {
  const std::filesystem::path out = arguments.out;
  const HeldFolder held(out);
  const TouchRecord touch = read_touch_record(arguments.touch_record);
  if (touch.malformed_images > 0)
    std::fprintf(stderr, "warning: %llu malformed tactile images of the recording are left out\n",
                 static_cast<unsigned long long>(touch.malformed_images));
  std::function<void()> draw_forces = [&] { draw_force(out / "force.png", felt_force(touch)); };
  const nlohmann::json summary =
      arguments.tissue.empty() ? summarise(touch, TELETACT_VERSION) : judged(arguments, touch, draw_forces);
  write_file(out / "summary.json", summary.dump(2) + "\n");
  draw_forces();
  draw_latency(out / "latency.png", touch);
  draw_periods(out / "periods.png", touch);
  draw_tactile(out / "tactile.png", touch);
  std::printf("%s%s", readable(summary).c_str(), not_met(summary).c_str());
  std::fflush(stdout);
  for (const Promise& promise : promises_of(summary))
    if (!promise.met()) return false;
  return true;
}

}  // namespace

void add_report_command(CLI::App& app) {
  const auto arguments = std::make_shared<ReportArguments>();
  CLI::App& command =
      *app.add_subcommand("report", "recordings and the true tissue -> summary.json and pictures");
  CLI::Option* tissue =
      command.add_option("--tissue", arguments->tissue,
                         "the true plane tissue (acquire --save-tissue); without it no force is judged");
  command.add_option("--touch-record", arguments->touch_record, "written by touch --record")->required();
  CLI::Option* acquire =
      command.add_option("--acquire-record", arguments->acquire_record,
                         "written by acquire --record; without it windows and inclusions are left out");
  tissue->needs(acquire);
  acquire->needs(tissue);
  command.add_option("--out", arguments->out, "folder for summary.json and the pictures")->required();
  command.callback([arguments] {
    if (!run(*arguments)) throw CLI::RuntimeError(kPromisesMissed);
  });
}

}  // namespace teletact::client
