#include "client/watch/sources.h"

#include <poll.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

#include "client/link/channel.h"
#include "client/link/recording.h"
#include "client/link/retry.h"
#include "client/link/scenes.h"
#include "common/file_descriptor.h"

namespace teletact::client {
namespace {

void nap(double wait_s, const std::atomic<bool>& stop) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(wait_s);
  while (!stop && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
}

// What wakes whoever waits for a file to grow.
FileDescriptor growth_of(const std::string& path) {
  FileDescriptor watched(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC));
  ::inotify_add_watch(watched.get(), path.c_str(), IN_MODIFY);
  return watched;
}

// At most 50 ms: on a file system of another machine nothing wakes.
void wait_for(const FileDescriptor& growth) {
  pollfd polled{growth.get(), POLLIN, 0};
  ::poll(&polled, 1, 50);
  std::array<char, 4096> events{};
  [[maybe_unused]] const auto read = ::read(growth.get(), events.data(), events.size());
}

}  // namespace

SessionSource::SessionSource(std::string path, std::string name, bool first, View& view)
    : path_(std::move(path)), name_(std::move(name)), first_(first), view_(view), thread_([this] {
        run();
      }) {}

SessionSource::~SessionSource() {
  stop_ = true;
  thread_.join();
}

void SessionSource::run() {
  constexpr double kRetryS = 0.2;
  view_.tell(name_, "waiting for " + path_);
  std::optional<std::uint64_t> broken;  // a damaged file is not read again
  for (; !stop_; nap(kRetryS, stop_)) {
    struct stat status {};
    if (broken && ::stat(path_.c_str(), &status) == 0 && status.st_ino == *broken) continue;
    broken.reset();
    std::string why = "ended";
    bool followed = false;
    try {
      RecordReader reader(path_);
      if (!reader.is_written()) continue;  // of an earlier session
      followed = true;
      follow(reader);
    } catch (const std::exception& error) {
      std::error_code unseen;
      if (!std::filesystem::exists(path_, unseen) && !unseen) continue;
      why = std::string("broken off: ") + error.what();
      if (followed && ::stat(path_.c_str(), &status) == 0) broken = status.st_ino;
    }
    if (first_) view_.complete_row();
    view_.tell(name_, why);
  }
}

void SessionSource::follow(RecordReader& reader) {
  const FileDescriptor growth = growth_of(path_);
  if (first_) view_.restart();
  v1::RecordEntry header;
  *header.mutable_header() = reader.header();
  view_.take(header);
  for (bool written = true, live = false; !stop_;) {
    if (const auto entry = reader.next()) {
      view_.take(*entry);
    } else if (!written) {
      return;
    } else {
      if (!std::exchange(live, true)) view_.tell(name_, "live");
      written = reader.is_written();  // before the last look at what it wrote
      if (written) wait_for(growth);
    }
  }
}

SceneSource::SceneSource(std::string address, Credentials credentials, std::string scene_id, View& view)
    : address_(std::move(address)),
      credentials_(std::move(credentials)),
      scene_id_(std::move(scene_id)),
      view_(view),
      thread_([this] { run(); }) {}

SceneSource::~SceneSource() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
    if (context_ != nullptr) context_->TryCancel();
  }
  thread_.join();
}

SceneSource::Wanted SceneSource::wanted() const {
  return {address_.empty() ? view_.header().service() : address_,
          scene_id_.empty() ? view_.header().scene_id() : scene_id_, view_.session_id()};
}

void SceneSource::run() {
  Backoff backoff(kRetryS, kMaxRetryS);
  Wanted before;
  for (double wait_s = kRetryS; !stop_; nap(wait_s, stop_)) {
    wait_s = kRetryS;
    const Wanted now = wanted();
    if (now.address != before.address || now.scene_id != before.scene_id) view_.look_away(true);
    if (now != before) backoff.restart();
    before = now;
    if (now.scene_id.empty() || !address_problem(now.address).empty()) continue;
    const grpc::Status status = look_on(now);
    view_.look_away();
    if (status.ok()) continue;
    view_.tell("service_state", describe(status));
    // A service that starts again is looked at soon.
    if (status.error_code() == grpc::StatusCode::UNAVAILABLE)
      backoff.restart();
    else
      wait_s = backoff.next_s();
  }
}

grpc::Status SceneSource::look_on(const Wanted& at) {
  // A new connection each time: the old one may be half-open.
  const auto stub = v1::Palpation::NewStub(make_channel(at.address, credentials_));
  grpc::ClientContext context;
  name_scene(context, at.scene_id);
  {
    const std::lock_guard lock(mutex_);
    if (stop_) return grpc::Status::OK;
    context_ = &context;
  }
  const auto stream = stub->Observe(&context);
  v1::ObserveRequest request;
  v1::ObserveOpen& open = *request.mutable_open();
  open.set_scene_id(at.scene_id), open.set_session_id(at.session_id);
  open.set_windows(true), open.set_surface(true);
  for (const char* map : {"youngs_modulus", "youngs_modulus_log_std", "valid", "b_mode"}) open.add_maps(map);
  bool goes_on = true;
  for (v1::Observation seen; goes_on && stream->Write(request) && stream->Read(&seen);) {
    view_.tell("service_state", "answers");
    view_.take_observed(seen);
    request.set_acknowledged(seen.state());
    goes_on = wanted() == at;
  }
  if (!goes_on) context.TryCancel();
  const grpc::Status status = stream->Finish();
  const std::lock_guard lock(mutex_);
  context_ = nullptr;
  return goes_on && !stop_ ? status : grpc::Status::OK;
}

}  // namespace teletact::client
