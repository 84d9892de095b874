// teletact-client report: recordings and the true tissue -> summary.json and pictures.
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "client/commands/commands.h"
#include "client/files/file_io.h"
#include "client/report/pictures.h"
#include "client/report/summary.h"

namespace teletact::client {
namespace {

constexpr int kPromisesMissed = 2;  // exit code, beside 1 for a report that could not be made

struct Arguments {
  std::string tissue, touch_record, acquire_record, out;
};

bool run(const Arguments& arguments) {
  const std::filesystem::path out = arguments.out;
  std::error_code error;
  std::filesystem::create_directories(out, error);
  if (error) throw CommandError("--out " + arguments.out + ": cannot be created (" + error.message() + ")");
  const TouchRecord touch = read_touch_record(arguments.touch_record);
  const AcquireRecord acquire = read_acquire_record(arguments.acquire_record);
  if (const std::string doubt = session_mismatch(touch, acquire); !doubt.empty())
    std::fprintf(stderr, "warning: %s\n", doubt.c_str());
  const Tissue tissue = read_tissue(arguments.tissue);
  const ModulusGrid modulus = measured_modulus(acquire);
  const InclusionReport inclusions = find_inclusions(modulus, tissue.inclusions);
  std::fprintf(stderr, "solving the true tissue's forces along the path\n");
  const ForceError force = force_error(Patient(tissue), touch);
  const nlohmann::json summary = summarise(tissue, touch, acquire, force, inclusions, TELETACT_VERSION);
  write_file(out / "summary.json", summary.dump(2) + "\n");
  draw_modulus(out / "modulus.png", tissue, modulus);
  draw_force(out / "force.png", force);
  draw_latency(out / "latency.png", touch);
  draw_periods(out / "periods.png", touch);
  draw_tactile(out / "tactile.png", touch);
  std::printf("%s", readable(summary).c_str());
  std::fflush(stdout);
  for (const Promise& promise : promises_of(summary))
    if (!promise.met()) return false;
  return true;
}

}  // namespace

void add_report_command(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command =
      *app.add_subcommand("report", "recordings and the true tissue -> summary.json and pictures");
  command.add_option("--tissue", arguments->tissue, "the true tissue (acquire --save-tissue)")->required();
  command.add_option("--touch-record", arguments->touch_record, "written by touch --record")->required();
  command.add_option("--acquire-record", arguments->acquire_record, "written by acquire --record")
      ->required();
  command.add_option("--out", arguments->out, "folder for summary.json and the pictures")->required();
  command.callback([arguments] {
    if (!run(*arguments)) throw CLI::RuntimeError(kPromisesMissed);
  });
}

}  // namespace teletact::client
