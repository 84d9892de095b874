#include "client/watch/sources.h"

#include <google/protobuf/io/coded_stream.h>
#include <poll.h>
#include <sys/socket.h>

#include <chrono>
#include <memory>
#include <utility>

#include "client/link/channel.h"
#include "client/link/recording.h"
#include "client/link/scenes.h"
#include "client/link/unix_socket.h"

namespace teletact::client {
namespace {

constexpr std::uint32_t kMostEntryBytes = 16 << 20;

void nap(double wait_s, const std::atomic<bool>& stop) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(wait_s);
  while (!stop && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
}

// Takes entries off the front of what came. None: the rest is a part of one. Throws when it is none.
bool next_entry(std::string& bytes, std::size_t& at, v1::RecordEntry& entry) {
  google::protobuf::io::CodedInputStream coded(reinterpret_cast<const std::uint8_t*>(bytes.data()) + at,
                                               static_cast<int>(bytes.size() - at));
  std::uint32_t size = 0;
  if (!coded.ReadVarint32(&size)) return false;
  if (size > kMostEntryBytes) throw std::runtime_error("an entry of " + std::to_string(size) + " bytes");
  const auto begin = static_cast<std::size_t>(coded.CurrentPosition());
  if (bytes.size() - at - begin < size) return false;
  if (!entry.ParseFromArray(bytes.data() + at + begin, static_cast<int>(size)))
    throw std::runtime_error("what came is no entry of a session");
  at += begin + size;
  return true;
}

}  // namespace

PublishedSource::PublishedSource(std::string path, std::string name, bool first, View& view)
    : path_(std::move(path)), name_(std::move(name)), first_(first), view_(view), thread_([this] {
        run();
      }) {}

PublishedSource::~PublishedSource() {
  stop_ = true;
  thread_.join();
}

void PublishedSource::run() {
  constexpr double kRetryS = 0.2;
  view_.tell(name_, "waiting for " + path_);
  while (!stop_) {
    const Descriptor file = connect_to(path_);
    if (!file) {
      nap(kRetryS, stop_);
      continue;
    }
    std::string why = "ended";
    try {
      read(file.get());
    } catch (const std::exception& error) {
      why = std::string("broken off: ") + error.what();
    }
    view_.tell(name_, why);
    nap(kRetryS, stop_);
  }
}

void PublishedSource::read(int file) {
  std::string bytes;
  std::vector<char> buffer(1 << 16);
  std::size_t at = 0;
  v1::RecordEntry entry;
  while (!stop_) {
    pollfd polled{file, POLLIN, 0};
    if (::poll(&polled, 1, 50) <= 0) continue;
    const ssize_t got = ::recv(file, buffer.data(), buffer.size(), 0);
    if (got <= 0) return;
    bytes.append(buffer.data(), static_cast<std::size_t>(got));
    while (next_entry(bytes, at, entry)) {
      if (entry.has_header()) {
        if (entry.header().version() != kRecordingVersion)
          throw std::runtime_error("it is of version " + std::to_string(entry.header().version()) +
                                   ", and this client reads version " + std::to_string(kRecordingVersion));
        if (first_) view_.restart();
        view_.tell(name_, "live");
      }
      view_.take(entry);
    }
    bytes.erase(0, std::exchange(at, 0));
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

std::string SceneSource::wanted_address() const {
  return address_.empty() ? view_.header().service() : address_;
}

std::string SceneSource::wanted_scene() const {
  return scene_id_.empty() ? view_.header().scene_id() : scene_id_;
}

void SceneSource::run() {
  for (; !stop_; nap(kRetryS, stop_)) {
    const std::string address = wanted_address(), scene_id = wanted_scene();
    if (scene_id.empty() || !address_problem(address).empty()) continue;
    const grpc::Status status = look_on(address, scene_id);
    view_.look_away();
    if (!status.ok()) view_.tell("service_state", describe(status));
  }
}

grpc::Status SceneSource::look_on(const std::string& address, const std::string& scene_id) {
  // A new connection each time: the old one may be half-open.
  const auto stub = v1::Palpation::NewStub(make_channel(address, credentials_));
  grpc::ClientContext context;
  name_scene(context, scene_id);
  {
    const std::lock_guard lock(mutex_);
    if (stop_) return grpc::Status::OK;
    context_ = &context;
  }
  const auto stream = stub->Observe(&context);
  v1::ObserveRequest request;
  v1::ObserveOpen& open = *request.mutable_open();
  open.set_scene_id(scene_id);
  open.set_windows(true), open.set_surface(true);
  for (const char* map : {"youngs_modulus", "youngs_modulus_log_std", "valid", "b_mode"}) open.add_maps(map);
  bool wanted = true;
  for (v1::Observation seen; wanted && stream->Write(request) && stream->Read(&seen);) {
    view_.tell("service_state", "answers");
    view_.take_observed(seen);
    request.set_acknowledged(seen.state());
    wanted = wanted_address() == address && wanted_scene() == scene_id;
  }
  if (!wanted) context.TryCancel();
  const grpc::Status status = stream->Finish();
  const std::lock_guard lock(mutex_);
  context_ = nullptr;
  return wanted && !stop_ ? status : grpc::Status::OK;
}

}  // namespace teletact::client
