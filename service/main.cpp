// teletact-service: the solver service on a compute node.
#include <grpc/support/log.h>
#include <malloc.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "service/base/log_formatter.h"
#include "service/base/shown.h"
#include "service/device/device.h"
#include "service/operation/admin.h"
#include "service/operation/configuration.h"
#include "service/rpc/server.h"

namespace {

using namespace teletact::service;

void start_logging(const std::string& level) {
  spdlog::set_default_logger(spdlog::stderr_logger_mt("teletact"));
  spdlog::set_formatter(log_formatter());
  const auto parsed = spdlog::level::from_str(level);
  if (parsed == spdlog::level::off && level != "off")
    throw std::runtime_error("--log-level " + shown(level) + ": one of trace, debug, info, warn, error, off");
  spdlog::set_level(parsed);
  // gRPC tells every failed bind in several lines; we tell it in one.
  gpr_set_log_function(
      [](gpr_log_func_args* args) { spdlog::debug("event=grpc message=\"{}\"", args->message); });
}

// Blocks of 4 MiB and more go back to the system when they are given up, and few heaps serve all
// threads. As glibc is set up, maps and factors of every size ended in the heap of each worker thread and
// left it full of holes: four times what was in use, and growing for an hour.
void bound_the_heap() {
  constexpr int kMappedBytes = 4 << 20, kHeaps = 2;
  mallopt(M_MMAP_THRESHOLD, kMappedBytes);
  mallopt(M_TRIM_THRESHOLD, kMappedBytes);
  mallopt(M_ARENA_MAX, kHeaps);
}

// As many connections as the system lets this process have: a thousand sockets that do nothing keep nobody
// out.
void raise_open_files() {
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) return;
  files.rlim_cur = files.rlim_max;
  setrlimit(RLIMIT_NOFILE, &files);
}

// Blocked before there is any thread, so that all inherit it and only those who wait for them take them. A
// terminal that is closed stops the service, too, but not one that was started by nohup. SIGHUP is blocked
// there as well: LLVM, which compiles kernels, sets a handler in the place of nohup's SIG_IGN, and that lets
// SIGTERM end the process at once while it runs.
sigset_t block_stop_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  struct sigaction hangup {};
  const bool nohup = ::sigaction(SIGHUP, nullptr, &hangup) == 0 && hangup.sa_handler == SIG_IGN;
  sigaddset(&signals, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  if (nohup) sigdelset(&signals, SIGHUP);
  return signals;
}

struct Running {
  std::unique_ptr<Server> server;
  std::unique_ptr<HttpListener> admin;  // where it was asked for; goes first
};

Running start(ServeOptions options) {
  constexpr int kDeviceNiceness = 5;  // kernels run below touch
  options.device.niceness = kDeviceNiceness;
  if (options.devices.empty()) options.devices = {options.device.select};
  const std::vector<DeviceOptions> chosen = choose_devices(options.devices, options.device);
  options.server.reopen = [chosen](std::size_t number) { return Device::open(chosen.at(number)); };
  std::vector<std::shared_ptr<Device>> devices;
  for (const DeviceOptions& device : chosen) devices.push_back(Device::open(device));
  Running running{std::make_unique<Server>(devices, options.server), nullptr};
  if (!options.admin.empty()) running.admin = listen_for_admin(options.admin, running.server->core());
  running.server->make_ready();
  return running;
}

// Starting compiles kernels, unless an earlier start did, and restores scenes. Nothing can interrupt that, so
// it says where it is. A signal meanwhile ends the process on the spot: nobody is served yet, and the state
// on disk is whole at every moment.
Running start_unless_stopped(const ServeOptions& options, const sigset_t& signals) {
  constexpr std::chrono::seconds kSaid{2};
  auto starting = std::async(std::launch::async, [&options] { return start(options); });
  auto say = std::chrono::steady_clock::now() + kSaid;
  while (starting.wait_for(std::chrono::milliseconds(20)) != std::future_status::ready) {
    if (std::chrono::steady_clock::now() > say) {
      spdlog::info("event=compiling step={} of={}", compile_steps(), Server::kCompileSteps);
      say += kSaid;
    }
    const timespec now{};
    const int signal = sigtimedwait(&signals, nullptr, &now);
    if (signal <= 0) continue;
    spdlog::info("event=stopped_while_starting signal={}", signal);
    std::_Exit(0);
  }
  return starting.get();
}

// The process ends when so much has passed, and 1.5 s, unless it is `over` by then, whatever the device's
// driver or the disk do: the state on disk is whole at every moment.
void end_in_time(double seconds, const std::shared_ptr<const std::atomic<bool>>& over = nullptr) {
  constexpr double kBeyondS = 1.5;
  std::thread([=] {
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds + kBeyondS));
    if (over && *over) return;
    spdlog::warn("event=drain_cut");
    std::_Exit(0);
  }).detach();
}

// So long, or until `over`, or until another signal comes: who sends two is in a hurry.
void pause(double seconds, const sigset_t& signals, const std::function<bool()>& over) {
  constexpr timespec kLook{0, 20'000'000};
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (std::chrono::steady_clock::now() < end && !over() && sigtimedwait(&signals, nullptr, &kLook) <= 0)
    continue;
}

// `moves`: another service may stand by.
void stop(Server& server, bool moves, const sigset_t& signals) {
  Core& core = server.core();
  const auto moving = std::make_shared<std::atomic<bool>>(false);
  // What is not kept yet is written first, for the other one.
  end_in_time(core.limits.unready_s + (moves ? core.limits.move_s : 0) + core.limits.drain_s, moving);
  server.leave();
  pause(core.limits.unready_s, signals, [] { return false; });
  if (moves) {
    server.move();
    *moving = true;
    end_in_time(core.limits.move_s + core.limits.drain_s);
    pause(core.limits.move_s, signals, [&] { return core.calls.count(CallKind::kTouch) == 0; });
  }
  server.drain();
}

void serve(const CLI::App& command, ServeOptions options) {
  const auto begun = std::chrono::steady_clock::now();
  bound_the_heap();
  raise_open_files();
  read_configuration([&](const std::string& flag) { return command.count(flag) > 0; }, options);
  start_logging(options.log_level);
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is a write that fails
  const sigset_t signals = block_stop_signals();
  const auto [server, admin] = start_unless_stopped(options, signals);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;
  std::string devices;
  for (const CurrentDevice& device : server->core().devices)
    devices += (devices.empty() ? "device " : ", device ") + device->info().name;
  std::printf("teletact-service: serving on %s, %s, ready in %.2f s\n", server->address().c_str(),
              devices.c_str(), took.count());
  if (admin) std::printf("teletact-service: metrics and health on %s\n", admin->address().c_str());
  std::fflush(stdout);
  int signal = 0;
  sigwait(&signals, &signal);
  spdlog::info("event=signal signal={}", signal);
  stop(*server, options.server.standby, signals);
}

// Starts a service that nobody is told of, and so compiles what the next start would.
void compile_kernels(ServeOptions options) {
  const auto begun = std::chrono::steady_clock::now();
  start_logging(options.log_level);
  std::string folder = (std::filesystem::temp_directory_path() / "teletact-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) throw std::runtime_error(folder + ": cannot be made");
  options.server.listen.listen = "unix:" + folder + "/s";
  start_unless_stopped(options, block_stop_signals());
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;
  std::printf("teletact-service: kernels are ready, %zu steps in %.1f s\n", compile_steps(), took.count());
}

void print_devices(bool as_json) {
  const auto devices = list_devices();
  if (devices.empty()) throw DeviceError(no_device());
  nlohmann::json all = nlohmann::json::array();
  for (const DeviceInfo& d : devices) {
    all.push_back({{"index", d.index},
                   {"name", d.name},
                   {"vendor", d.vendor},
                   {"platform", d.platform},
                   {"version", d.version},
                   {"driver_version", d.driver_version},
                   {"has_double", d.has_double},
                   {"compute_units", d.compute_units},
                   {"global_memory_bytes", d.global_memory_bytes}});
    if (!as_json)
      std::printf("%zu  %s (%s, %s), %u compute units, %.1f GB, %s\n", d.index, d.name.c_str(),
                  d.platform.c_str(), d.driver_version.c_str(), d.compute_units,
                  double(d.global_memory_bytes) * 1e-9, d.has_double ? "double" : "float only");
  }
  if (as_json) std::printf("%s\n", all.dump(2).c_str());
}

void add_serve(CLI::App& app, ServeOptions& o) {
  CLI::App* command =
      app.add_subcommand("serve", "Serve elastography and palpation until SIGTERM, SIGINT or SIGHUP");
  command->add_option("--listen", o.server.listen.listen, "HOST:PORT or unix:/path")->capture_default_str();
  command->add_option("--admin", o.admin,
                      "metrics and health over HTTP, for this machine: 127.0.0.1:PORT or unix:/path");
  command->add_option(
      "--device", o.devices,
      "index of an OpenCL device, or part of its name; append /PARTS to divide it into equal parts; "
      "repeat for further devices");
  command
      ->add_option("--pairs-at-once", o.server.at_once,
                   "pairs of frames, of different scenes, that each device works on; default: on a GPU as "
                   "many as there are "
                   "cores but one, on a processor half as many")
      ->check(CLI::Range(std::size_t{1}, kMostAtOnce));
  command->add_option("--state", o.server.state_directory, "folder in which scenes survive the service");
  command->add_flag("--standby", o.server.standby,
                    "if another service holds the --state folder, wait for it; when stopped, hand it to a "
                    "waiting service before touches end");
  command->add_option("--config", o.config, "TOML file with these options, '_' for '-'");
  command->add_option("--kernel-directory", o.device.kernel_directory,
                      "read .cl files from there (development)");
  command->add_flag("--allow-insecure-remote", o.server.listen.allow_insecure_remote,
                    "listen beyond this machine without encryption");
  command->add_option("--tls-certificate", o.server.listen.tls_certificate, "PEM certificate chain");
  command->add_option("--tls-key", o.server.listen.tls_key, "PEM private key");
  command->add_option("--tls-client-ca", o.server.listen.tls_client_ca,
                      "PEM certificate: only clients with one that it signed are let in");
  command->add_option(
      "--access", o.server.listen.access,
      "TOML file: who may do what, by token or certificate; without it whoever can connect may "
      "do everything");
  command->add_option("--log-level", o.log_level, "trace, debug, info, warn, error or off")
      ->capture_default_str();
  command->callback([command, &o] { serve(*command, o); });
}

void add_kernels(CLI::App& app, ServeOptions& o) {
  CLI::App* command = app.add_subcommand(
      "kernels",
      "Compile the kernels now, so that the next service starts in seconds; in the same cache folder");
  command->add_option("--device", o.devices, "as of serve");
  command->callback([&o] { compile_kernels(o); });
}

}  // namespace

// Seen from outside of the library that it is in for packages (CMakeLists.txt).
[[gnu::visibility("default")]] int main(int argc, char** argv) {
  CLI::App app("teletact-service: turns ultrasound into tissue that can be touched from afar",
               "teletact-service");
  app.set_version_flag("--version", "teletact-service " TELETACT_VERSION);
  app.require_subcommand(1);
  ServeOptions options;
  options.server.at_once = 0;
  add_serve(app, options);
  add_kernels(app, options);
  bool as_json = false;
  CLI::App* devices = app.add_subcommand("devices", "List the OpenCL devices");
  devices->add_flag("--json", as_json, "as JSON");
  devices->callback([&as_json] { print_devices(as_json); });
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "teletact-service: %s\n", error.what());
    return 1;
  }
  return 0;
}
