#include "bench/load/processes.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

namespace teletact::bench {
namespace {

constexpr double kStartS = 0.5, kStartOfEachS = 0.004;  // of processes, and of each client's stream

std::string quoted(const std::string& word) {
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

class Process {
 public:
  explicit Process(const LoadPlan& plan)
      : file_(std::filesystem::temp_directory_path() /
              fmt::format("teletact-load-{}-{}.json", getpid(), plan.first_client)) {
    std::ofstream out(file_);
    std::filesystem::permissions(file_, std::filesystem::perms::owner_read |
                                            std::filesystem::perms::owner_write);  // it may hold a token
    out << nlohmann::json(plan);
    const std::string self = std::filesystem::read_symlink("/proc/self/exe");
    pipe_ = popen((quoted(self) + " " + kLoadWorker + " " + quoted(file_)).c_str(), "r");
    if (pipe_ == nullptr) throw std::runtime_error("a process of the load could not be started");
  }
  ~Process() {
    if (pipe_ != nullptr) pclose(pipe_);
    std::error_code ignored;
    std::filesystem::remove(file_, ignored);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  Tally tally() {
    std::string text;
    char buffer[4096];
    for (std::size_t n = 0; (n = fread(buffer, 1, sizeof buffer, pipe_)) > 0;) text.append(buffer, n);
    const int status = pclose(std::exchange(pipe_, nullptr));
    try {
      if (status == 0) return nlohmann::json::parse(text).get<Tally>();
    } catch (const nlohmann::json::exception&) {
    }
    throw std::runtime_error("a process of the load ended without a result");  // it has said why
  }

 private:
  std::filesystem::path file_;
  FILE* pipe_ = nullptr;
};

}  // namespace

Tally run_processes(LoadPlan plan, unsigned processes) {
  const auto begin = std::chrono::steady_clock::now() +
                     std::chrono::duration<double>(kStartS + kStartOfEachS * plan.clients);
  plan.begin_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(begin.time_since_epoch()).count();
  std::vector<std::unique_ptr<Process>> started;
  const unsigned all = plan.clients;
  for (unsigned k = 0; k < processes; ++k) {
    plan.first_client = k * all / processes;
    plan.clients = (k + 1) * all / processes - plan.first_client;
    if (plan.clients > 0) started.push_back(std::make_unique<Process>(plan));
  }
  Tally tally;
  for (const auto& process : started) tally.add(process->tally());
  return tally;
}

}  // namespace teletact::bench
