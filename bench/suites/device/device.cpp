// teletact-bench device: what one device can, for ten minutes on one that is borrowed. Each part is a process
// of its own, which is ended at its limit; its rows are on disk as soon as they are known.
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <thread>

#include "bench/basics/clock.h"
#include "bench/device_figures.h"
#include "bench/run_suite.h"
#include "bench/suites/device/device.h"

namespace teletact::bench {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

struct Arguments : SuiteOptions {
  std::string device, part;  // part: of a process for one
  std::vector<std::string> only;
  double part_limit_s = 90;
  bool as_gpu = false, resume = false;
};

constexpr const char* kLimits = "limits";
// In order of worth.
const std::vector<std::pair<std::string, void (*)(DevicePart&)>>& parts() {
  static const std::vector<std::pair<std::string, void (*)(DevicePart&)>> all{
      {kLimits, [](DevicePart& part) { part.add(kLimits, measure_limits(part.options, part.quick)); }},
      {"displacement", measure_displacement},
      {"solids", measure_solids},
      {"planes", measure_planes},
      {"references", measure_references},
      {"windows", measure_windows},
      {"transforms", measure_transforms}};
  return all;
}

fs::path file_of(const Arguments& of, const std::string& part) {
  return fs::path(of.out) / (part + ".json");
}

json read(const fs::path& file) {
  std::ifstream stream(file);
  return stream ? json::parse(stream, nullptr, false) : json();
}

void write(const fs::path& file, const json& what) {
  const fs::path fresh = file.string() + ".new";
  std::ofstream stream(fresh);
  stream << what.dump(1) << '\n' << std::flush;
  stream.close();
  std::error_code error;
  if (stream) fs::rename(fresh, file, error);
  if (!stream || error) throw BenchError("cannot write " + file.string());
}

// When this program's file was written: others than those of the same build have another time.
std::string built() {
  struct stat of {};
  if (stat("/proc/self/exe", &of) != 0) return "unknown";
  return fmt::format("{:%F %T}", fmt::gmtime(of.st_mtime));
}

// Its file: what it is of, how it ended, its tables.
class WrittenPart : public DevicePart {
 public:
  WrittenPart(const service::DeviceOptions& options, const Arguments& of)
      : DevicePart(options, of.quick), file_(file_of(of, of.part)) {
    const service::DeviceInfo info = service::Device::open(options)->info();
    result_ = {{"of",
                {{"device", describe(info)},
                 {"platform", info.platform},
                 {"as_gpu", of.as_gpu},
                 {"built", built()},
                 {"quick", of.quick}}},
               {"ended", "not"}};
    for (const auto& [name, measure] : parts()) {
      const json other = read(file_of(of, name));
      if (other.is_object() && other.contains("of") && other["of"] != result_["of"])
        throw BenchError(
            fmt::format("{} is of another device, build or kind of run: {}; this one: {}. Choose "
                        "another folder for --out",
                        file_of(of, name).string(), other["of"].dump(), result_["of"].dump()));
      if (name == kLimits && other.is_object() && other.contains(kLimits))
        limits = other.at(kLimits).at(0).get<DeviceLimits>();
    }
    write(file_, result_);
  }
  void add(const char* table, const json& row) override {
    result_[table].push_back(row);
    write(file_, result_);
  }
  void end() {
    result_["ended"] = "complete";
    result_["seconds"] = seconds_since(begin_);
    write(file_, result_);
  }

 private:
  const fs::path file_;
  const Clock::time_point begin_ = Clock::now();
  json result_;
};

bool run_part(const Arguments& of) {
  service::DeviceOptions options;
  options.select = of.device, options.as_gpu = of.as_gpu;
  WrittenPart part(options, of);
  for (const auto& [name, measure] : parts())
    if (name == of.part) measure(part);
  part.end();
  return true;
}

// Runs it in a process of its own; what it wrote, and how it ended.
json ran(const Arguments& of, const std::string& part) {
  std::vector<std::string> words{
      fs::read_symlink("/proc/self/exe"), "device", "--out", of.out, "--part", part};
  if (!of.device.empty()) words.insert(words.end(), {"--device", of.device});
  if (of.quick) words.push_back("--quick");
  if (of.as_gpu) words.push_back("--as-gpu");
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    execv(arguments[0], arguments.data());
    _exit(127);
  }
  if (child < 0) throw BenchError("a process of the part " + part + " could not be started");
  int status = 0;
  bool stopped = false;
  for (const Clock::time_point begin = Clock::now(); waitpid(child, &status, WNOHANG) == 0;) {
    constexpr auto kLook = std::chrono::milliseconds(20);
    std::this_thread::sleep_for(kLook);
    if (stopped || seconds_since(begin) < of.part_limit_s) continue;
    stopped = true;
    kill(child, SIGKILL);
  }
  json result = read(file_of(of, part));
  if (!stopped && WIFEXITED(status) && WEXITSTATUS(status) == 0) return result;
  if (!result.is_object()) result = json::object();
  result["ended"] = stopped               ? fmt::format("stopped by its limit of {} s", of.part_limit_s)
                    : WIFSIGNALED(status) ? fmt::format("failed: signal {}", WTERMSIG(status))
                                          : "failed: it has said why";
  write(file_of(of, part), result);
  std::printf("%s: %s\n", part.c_str(), result["ended"].get<std::string>().c_str());
  return result;
}

// A part that was stopped by its limit would be again.
bool is_there(const json& result) {
  const std::string ended = result.is_object() ? result.value("ended", "not") : "not";
  return ended == "complete" || ended.starts_with("stopped");
}

// Rows of windows, those beside a touch stream joined with those of as many windows without.
json windows_in_short(const json& rows) {
  json out = json::array();
  for (const json& row : rows)
    if (row.at("beside_touch").get<bool>() && !out.empty()) {
      json& alone = out.back();
      alone["beside_touch_windows_s"] = row.at("windows_s");
      alone["touch_p99_ms"] = row.at("touch_p99_ms");
    } else {
      out.push_back({});
      for (const char* key : {"modulus", "at_once", "windows_s", "p50_ms", "p95_ms"})
        out.back()[key] = row.at(key);
    }
  return out;
}

// Windows of 256 lines a second, 16 at once, each with a core as fast as this machine's, and the device as
// modelled for 128 lines, which works on one after the other; by modulus.
json a_gpus_windows(const json& windows, const json& stages) {
  constexpr double kAtOnce = 16, kTimesTheLines = 2;
  json out = json::object();
  for (const json& stage : stages)
    for (const json& row : windows)
      if (stage.at("stage").get<std::string>().starts_with("displacement and strain") &&
          stage.at("a_gpu_modelled_ms").is_number() && row.at("at_once") == 1 &&
          !row.at("beside_touch").get<bool>()) {
        const double device_ms = kTimesTheLines * stage.at("a_gpu_modelled_ms").get<double>(),
                     core_ms = row.at("modulus_ms");
        out[row.at("modulus").get<std::string>() + "_modulus"] =
            1e3 * std::min(kAtOnce / (device_ms + core_ms), 1 / device_ms);
      }
  return out;
}

// What a page has room for: a row for each stage, on a processor with a GPU's ways beside its own; kernels
// that take at least a third of a stage; of the references the one that is nearest to its bound.
json in_short(const json& all) {
  constexpr double kMuch = 1.0 / 3;
  json page = json::object(), references = all.value("references", json::array());
  for (const auto& [table, rows] : all.items()) {
    if (table.ends_with("_stages"))
      for (const json& row : rows) {
        const bool gpu = row.at("a_gpu_modelled_ms").is_number();
        json& stages = page["stages"];
        if (row.at("ms").is_number() || !gpu)
          stages.push_back({{"stage", row.at("stage")}, {"ms", row.at("ms")}});
        const auto put = [&](const char* key, const char* from) { stages.back()[key] = row.at(from); };
        if (!gpu)
          put("launches", "launches"), put("waits", "waits");
        else
          put("a_gpus_launches", "launches"), put("a_gpus_waits", "waits"), put("a_gpus_looks", "looks"),
              put("a_gpus_chain", "longest_chain"), put("a_gpu_modelled_ms", "a_gpu_modelled_ms");
      }
    if (table.ends_with("_kernels")) {
      std::map<std::string, double> ms;
      for (const json& row : rows) ms[row.at("stage")] += row.at("ms").get<double>();
      for (const json& row : rows)
        if (row.at("ms").get<double>() >= kMuch * ms[row.at("stage")])
          page["kernels"].push_back({{"stage", row.at("stage")},
                                     {"kernel", row.at("kernel")},
                                     {"share", row.at("ms").get<double>() / ms[row.at("stage")]},
                                     {"bound", row.at("bound")},
                                     {"of_limit", row.at("of_limit")}});
    }
    if (table == kLimits) page[table] = rows.at(0);
    if (table == "windows") page[table] = windows_in_short(rows);
    if (table == "transforms") page[table] = rows;
  }
  if (const json windows = a_gpus_windows(all.value("windows", json::array()),
                                          all.value("displacement_stages", json::array()));
      !windows.empty())
    page["a_gpu_modelled_windows_s"] = windows;
  const auto nearness = [](const json& row) {
    return row.at("off").get<double>() / row.at("bound").get<double>();
  };
  const auto nearest =
      std::max_element(references.begin(), references.end(),
                       [&](const json& a, const json& b) { return nearness(a) < nearness(b); });
  if (nearest != references.end()) page["reference_nearest_to_its_bound"] = *nearest;
  return page;
}

bool run_device(const Arguments& of) {
  if (!of.part.empty()) return run_part(of);
  fs::create_directories(of.out);
  const auto chosen = [&of](const std::string& name) {
    return of.only.empty() || std::find(of.only.begin(), of.only.end(), name) != of.only.end();
  };
  for (const std::string& name : of.only)
    if (std::none_of(parts().begin(), parts().end(), [&name](const auto& p) { return p.first == name; }))
      throw BenchError("--only " + name + ": no such part; --help lists them");
  for (const auto& [name, measure] : parts()) {
    if (of.resume || !chosen(name) || !fs::exists(file_of(of, name))) continue;
    if (!of.force)
      throw BenchError(file_of(of, name).string() +
                       " is there: go on with --resume, write over it with --force, or choose another --out");
    fs::remove(file_of(of, name));
  }
  json figures = json::object(), all = json::object(), of_all;
  double failed = 0, off = 0;
  for (const auto& [name, measure] : parts()) {
    json result = read(file_of(of, name));
    if (!chosen(name) && !is_there(result)) continue;
    if (chosen(name) && !(of.resume && is_there(result))) {
      std::printf("-- %s\n", name.c_str());
      result = ran(of, name);
    }
    if (result.value("ended", "not") != "complete") failed += name == "references" || !is_there(result);
    if (result.contains("of")) {
      if (!of_all.is_null() && of_all != result["of"])
        throw BenchError(
            fmt::format("the parts in {} are of another device, build or kind of run: {}, and {}; choose "
                        "another folder for --out, or --force",
                        of.out, of_all.dump(), result["of"].dump()));
      of_all = result["of"];
      for (const auto& [key, value] : of_all.items())
        if (key != "built") figures[key] = value;
    }
    if (const std::string ended = result.value("ended", "not"); ended != "complete")
      figures["parts"].push_back({{"name", name}, {"ended", ended}});
    for (const auto& [table, rows] : result.items())
      if (rows.is_array()) all[table == name ? name : name + "_" + table] = rows;
    for (const json& row : result.value("references", json::array())) off += !row.at("met").get<bool>();
  }
  figures.update(in_short(all));
  figures["all"] = all;
  SuiteOptions written = of;
  written.json = fs::path(of.out) / "device.json";
  return finish("device", figures, {{"failed_parts", failed, 0}, {"references_missed", off, 0}}, written);
}

}  // namespace

void add_device_suite(CLI::App& app, bool& met) {
  const auto of = std::make_shared<Arguments>();
  CLI::App& command =
      *app.add_subcommand("device", "what one device can: ten minutes on one that is borrowed");
  command.callback([of, &met] { met = run_device(*of); });
  std::string names;
  for (const auto& [name, measure] : parts()) names += (names.empty() ? "" : ", ") + name;
  command.add_option("--out", of->out, "folder for the figures: a file of each part, and device.json")
      ->required();
  command.add_option("--device", of->device, "number of the device, or part of its name; else the first GPU");
  command.add_flag("--as-gpu", of->as_gpu, "kernels take a GPU's ways on a processor, too");
  command.add_option("--only", of->only, "parts: " + names);
  command
      .add_option("--part-limit-s", of->part_limit_s, "a part that takes longer is ended; its rows are kept")
      ->check(CLI::PositiveNumber);
  command.add_flag("--resume", of->resume, "go on: parts that are there are skipped");
  command.add_flag("--force", of->force, "write over an earlier run's files");
  command.add_flag("--quick", of->quick, "small sizes: to see that it works, not to quote");
  command.add_option("--part", of->part)->group("");  // of its own processes
}

}  // namespace teletact::bench
