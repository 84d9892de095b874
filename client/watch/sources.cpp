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
  stop_ = true;
  thread_.join();
}

void SceneSource::run() {
  constexpr std::chrono::seconds kDeadline{2};
  std::string address;
  std::unique_ptr<v1::Palpation::Stub> stub;
  std::uint64_t version = 0;
  for (; !stop_; nap(kEveryS, stop_)) {
    const v1::RecordHeader header = view_.header();
    const std::string wanted = address_.empty() ? header.service() : address_;
    const std::string scene_id = scene_id_.empty() ? header.scene_id() : scene_id_;
    if (wanted.empty() || scene_id.empty()) continue;
    if (!stub || wanted != address) {
      if (!address_problem(wanted).empty()) continue;
      address = wanted;
      stub = v1::Palpation::NewStub(make_channel(address, credentials_));
    }
    v1::Scene scene;
    grpc::Status status = get_scene(*stub, scene_id, v1::SCENE_VIEW_BASIC, scene, kDeadline);
    if (status.ok() && scene.version() != version)
      status = get_scene(*stub, scene_id, v1::SCENE_VIEW_FULL, scene, kDeadline);
    view_.tell("service_state", status.ok() ? "answers" : describe(status));
    if (!status.ok() || scene.version() == version) continue;
    version = scene.version();
    view_.take_scene(scene);
  }
}

}  // namespace teletact::client
