#include "bench/suite.h"

#include <fmt/chrono.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <thread>

namespace teletact::bench {
namespace {

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

void add_common_options(CLI::App& command, SuiteOptions& options) {
  command.parse_complete_callback([&options] { require_writable(options); });
  command.add_option("--json", options.json, "write the figures to this file");
  command.add_option("--out", options.out, "folder for pictures");
  command.add_flag("--quick", options.quick, "short: to see that it works, not to quote");
  command.add_flag("--force", options.force, "write over a --json that exists");
  command.add_option("--replot", options.replot,
                     "draw the pictures of an earlier --json into --out; measures nothing");
}

nlohmann::json machine() {
  utsname kernel{};
  uname(&kernel);
  const double memory =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
  return {{"date", fmt::format("{:%F}", fmt::gmtime(std::time(nullptr)))},
          {"version", TELETACT_VERSION},
          {"processor", processor_name()},
          {"cores", std::thread::hardware_concurrency()},
          {"memory_bytes", memory},
          {"kernel", std::string(kernel.sysname) + " " + kernel.release},
          {"compiler", __VERSION__}};
}

nlohmann::json quantiles(std::vector<double> seconds) {
  if (seconds.empty()) throw BenchError("nothing was answered: there is nothing to report");
  std::sort(seconds.begin(), seconds.end());
  const auto at = [&](double share) {
    const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(seconds.size())));
    return seconds[std::max<std::size_t>(rank, 1) - 1];
  };
  return {{"count", seconds.size()}, {"p50", at(0.5)}, {"p95", at(0.95)}, {"p99", at(0.99)}, {"max", at(1)}};
}

bool finish(nlohmann::json& result, const std::vector<Target>& targets, const SuiteOptions& options) {
  bool met = true;
  result["machine"] = machine();
  result["quick"] = options.quick;
  result["targets"] = nlohmann::json::array();
  for (const Target& t : targets) {
    met = met && t.met();
    result["targets"].push_back({{"name", t.name},
                                 {"value", t.value},
                                 {"target", t.target},
                                 {"unit", t.unit},
                                 {"at_most", t.at_most},
                                 {"met", t.met()}});
    std::printf("%-8s %s: %.4g, promised %s %.4g%s\n", t.met() ? "met" : "NOT MET", t.name.c_str(), t.value,
                t.at_most ? "at most" : "at least", t.target, t.unit == "1" ? "" : (" " + t.unit).c_str());
  }
  if (!options.json.empty() && !(std::ofstream(options.json) << result.dump(1) << '\n' << std::flush))
    throw BenchError("cannot write --json " + options.json);
  return met;
}

void show_progress(const std::string& line) {
  if (isatty(STDOUT_FILENO) == 0) return;
  std::printf("%s  \r", line.c_str());
  std::fflush(stdout);
}

bool replotted(const SuiteOptions& options, const std::string& suite,
               void (*draw)(const nlohmann::json& result, const std::string& folder)) {
  if (options.replot.empty()) return false;
  if (options.out.empty()) throw BenchError("--replot needs --out");
  std::ifstream file(options.replot);
  if (!file) throw BenchError("cannot read --replot " + options.replot);
  const nlohmann::json result = nlohmann::json::parse(file, nullptr, false);
  const BenchError foreign("--replot " + options.replot + ": not the --json of this suite (" + suite + ")");
  if (!result.is_object() || !result.contains("suite") || result["suite"] != suite) throw foreign;
  try {
    draw(result, options.out);
  } catch (const nlohmann::json::exception&) {
    throw foreign;  // of another version, or changed by hand
  }
  return true;
}

void plot(const std::filesystem::path& file, const std::string& script) {
  const std::string whole = "set terminal pngcairo size 900,600 font 'sans,11'\nset output '" +
                            file.string() + "'\nset grid lc rgb '#dddddd'\n" + script;
  FILE* pipe = popen("gnuplot", "w");
  if (pipe == nullptr) throw BenchError("gnuplot could not be started; install gnuplot-nox");
  const bool written = std::fwrite(whole.data(), 1, whole.size(), pipe) == whole.size();
  if (pclose(pipe) != 0 || !written)
    throw BenchError(file.string() + ": gnuplot failed; is gnuplot-nox installed?");
}

}  // namespace teletact::bench
