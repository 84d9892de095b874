#include "bench/run_suite.h"

#include <fmt/chrono.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <thread>

namespace teletact::bench {
namespace {

using nlohmann::json;

std::string processor_name() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  return "unknown";
}

// A run of minutes must not end in a file that cannot be written.
void require_writable(const SuiteOptions& options) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (!options.json.empty()) {
    const fs::path file = fs::absolute(options.json);
    const bool exists = fs::is_regular_file(file, error);
    if (exists && !options.force)
      throw BenchError("--json " + options.json +
                       ": it exists; choose another file, or write over it with --force");
    fs::create_directories(file.parent_path(), error);
    const bool opened = std::ofstream(file, std::ios::app).is_open();
    if (opened && !exists) fs::remove(file, error);  // a run that fails leaves nothing
    if (!opened)
      throw BenchError("cannot write --json " + options.json +
                       "; give a file in a folder that you may write to");
  }
  if (options.out.empty()) return;
  fs::create_directories(options.out, error);
  if (!fs::is_directory(options.out, error) || ::access(options.out.c_str(), W_OK | X_OK) != 0)
    throw BenchError("cannot write into --out " + options.out + "; give a folder that you may write to");
}

}  // namespace

CLI::App& add_suite(CLI::App& app, const char* name, const char* about, SuiteOptions& options, bool& met,
                    std::function<bool()> run) {
  CLI::App& command = *app.add_subcommand(name, about);
  command.parse_complete_callback([&options] { require_writable(options); });
  command.callback([&met, run = std::move(run)] { met = run(); });
  command.add_option("--json", options.json, "write the figures to this file");
  command.add_option("--out", options.out, "folder for pictures");
  command.add_flag("--quick", options.quick, "short: to see that it works, not to quote");
  command.add_flag("--force", options.force, "write over a --json that exists");
  command.add_option("--replot", options.replot,
                     "draw the pictures of an earlier --json into --out; measures nothing");
  return command;
}

json machine() {
  utsname kernel{};
  uname(&kernel);
  const std::string release = kernel.release;
  const double memory =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
  return {{"date", fmt::format("{:%F}", fmt::gmtime(std::time(nullptr)))},
          {"version", TELETACT_VERSION},
          {"processor", processor_name()},
          {"cores", std::thread::hardware_concurrency()},
          {"memory_bytes", memory},
          {"kernel", fmt::format("{} {}", kernel.sysname, release.substr(0, release.find('-')))},
          {"compiler", __VERSION__}};
}

Quantiles quantiles(std::vector<double> seconds) {
  if (seconds.empty()) throw BenchError("nothing was answered: there is nothing to report");
  std::sort(seconds.begin(), seconds.end());
  const auto at = [&](double share) {
    const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(seconds.size())));
    return seconds[std::max<std::size_t>(rank, 1) - 1];
  };
  return {seconds.size(), at(0), at(0.5), at(0.95), at(0.99), at(1)};
}

std::string snake_case(const std::string& text) {
  std::string name;
  for (const char c : text) {
    const bool word = std::isalnum(static_cast<unsigned char>(c)) != 0;
    if (word || (!name.empty() && name.back() != '_'))
      name += word ? static_cast<char>(std::tolower(static_cast<unsigned char>(c))) : '_';
  }
  while (!name.empty() && name.back() == '_') name.pop_back();
  return name;
}

bool finish(const std::string& suite, json figures, const Promises& promises, const SuiteOptions& options) {
  bool met = true;
  figures["suite"] = suite;
  figures["machine"] = machine();
  figures["quick"] = options.quick;
  figures["targets"] = json::array();
  for (const client::Promise& t : promises) {
    met = met && t.met();
    figures["targets"].push_back({{"name", t.name},
                                  {"value", t.value},
                                  {"target", t.target},
                                  {"unit", t.unit},
                                  {"at_most", t.at_most},
                                  {"met", t.met()}});
    std::printf("%-8s %s: %.4g, promised %s %.4g%s\n", t.met() ? "met" : "NOT MET", t.name.c_str(), t.value,
                t.at_most ? "at most" : "at least", t.target, t.unit.empty() ? "" : (" " + t.unit).c_str());
  }
  if (!options.json.empty() && !(std::ofstream(options.json) << figures.dump(1) << '\n' << std::flush))
    throw BenchError("cannot write --json " + options.json);
  return met;
}

void show_progress(const std::string& line) {
  if (isatty(STDOUT_FILENO) == 0) return;
  std::printf("%s  \r", line.c_str());
  std::fflush(stdout);
}

void throw_foreign(const std::string& suite, const SuiteOptions& options) {
  throw BenchError("--replot " + options.replot + ": not the --json of this suite (" + suite + ")");
}

json earlier_figures(const std::string& suite, const SuiteOptions& options) {
  if (options.out.empty()) throw BenchError("--replot needs --out");
  std::ifstream file(options.replot);
  if (!file) throw BenchError("cannot read --replot " + options.replot);
  json figures = json::parse(file, nullptr, false);
  if (!figures.is_object() || !figures.contains("suite") || figures["suite"] != suite)
    throw_foreign(suite, options);
  const std::function<void(json&)> say_nan = [&say_nan](json& value) {
    if (value.is_null()) value = std::nan("");
    if (value.is_structured())
      for (json& inner : value) say_nan(inner);
  };
  say_nan(figures);
  return figures;
}

void add_suite(CLI::App& app, const char* name, const char* about, const char* experiments,
               std::vector<Part> parts, bool& met) {
  struct Arguments : SuiteOptions {
    std::string experiment = "all";
  };
  const auto arguments = std::make_shared<Arguments>();
  std::vector<std::string> names{"all"};
  for (const Part& part : parts) names.emplace_back(part.name);
  const auto measure = [parts](const Arguments& of, Promises& promises) {
    json figures = json::object();
    for (const Part& part : parts)
      if (of.experiment == "all" || of.experiment == part.name)
        figures[part.name] = part.measure(of.quick, promises);
    return figures;
  };
  const auto draw = [parts](const json& figures, const std::filesystem::path& folder) {
    for (const Part& part : parts)
      if (figures.contains(part.name)) part.draw(figures[part.name], folder);
  };
  add_suite(app, name, about, arguments, met, measure, draw)
      .add_option("experiment", arguments->experiment, experiments)
      ->check(CLI::IsMember(names));
}

}  // namespace teletact::bench
