// A disk in memory that loses what was not synced. It counts operations; at one of them the power may fail,
// or it may fail itself. After a power failure each thing that was not synced is there or not, as chance has
// it: the names that a folder was given or lost, in their order, and a file's bytes, of which a part may be
// there.
#pragma once

#include <cerrno>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "service/scene/files.h"

namespace teletact::service {

struct PowerFailed {};  // no std::exception: nobody goes on after it

class LosingDisk : public Files {
 public:
  enum class Unsynced { kLost, kKept, kByChance };

  // Of the operations to come, from 0: the power fails at this one.
  void fail_power_at(std::size_t operation) { power_fails_at_ = count_ + operation; }
  // From this one on, `number` is errno of each that needs room (all: of each that writes at all).
  void fail_from(std::size_t operation, int number, bool all = false) {
    fails_from_ = count_ + operation, error_ = number, all_ = all;
  }
  void work_again() { fails_from_ = kNever; }
  std::size_t count() const { return count_; }

  // The power comes back.
  void restart(Unsynced unsynced, unsigned seed) {
    std::mt19937 random(seed);
    const auto kept = [&] {
      return unsynced == Unsynced::kKept || (unsynced == Unsynced::kByChance && random() % 2 == 0);
    };
    for (const Change& change : unsynced_)
      if (kept()) apply(change);
    unsynced_.clear();
    std::set<Node*> seen;
    settle(*root_, seen, unsynced, random);
    power_fails_at_ = kNever;
    dead_ = false;
  }

  bool exists(const Path& path) override {
    if (dead_) throw PowerFailed();
    return find(path) != nullptr;
  }
  std::vector<std::string> list(const Path& folder) override {
    std::vector<std::string> names;
    const auto listed = at("list", folder);
    for (const auto& [name, node] : listed->names) names.push_back(name);
    return names;
  }
  std::uint64_t size(const Path& file) override { return at("read", file)->bytes.size(); }
  std::string read(const Path& file, std::uint64_t most) override {
    if (size(file) > most) throw FileError("read", file, EFBIG);
    return at("read", file)->bytes;
  }
  void make_folder(const Path& path) override {
    step("make", path, true);
    if (const auto node = find(path)) {
      if (!node->folder) throw FileError("make", path, ENOTDIR);
      return;
    }
    auto node = std::make_shared<Node>();
    node->folder = true;
    change({{at("make", path.parent_path()), path.filename(), node}});
  }
  void write(const Path& path, std::span<const char> bytes) override {
    auto node = find(path);
    if (!node) {
      step("write", path, true);
      node = std::make_shared<Node>();
      change({{at("write", path.parent_path()), path.filename(), node}});
    }
    node->bytes.clear();
    step("write", path, true);  // at any byte of it
    node->bytes.assign(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(bytes.size() / 2));
    step("write", path, true);
    node->bytes.assign(bytes.begin(), bytes.end());
  }
  void sync(const Path& path) override {
    const auto node = at("sync", path);
    step("sync", path, true);
    node->bytes_on_disk = node->bytes;
    std::vector<Change> left;
    for (Change& change : unsynced_) {
      const bool here =
          std::any_of(change.begin(), change.end(), [&](const Entry& entry) { return entry.in == node; });
      if (here)
        apply(change);
      else
        left.push_back(std::move(change));
    }
    unsynced_ = std::move(left);
  }
  void rename(const Path& from, const Path& to) override {
    step("rename", from, false);
    const auto node = at("rename", from);
    change({{at("rename", from.parent_path()), from.filename(), nullptr},
            {at("rename", to.parent_path()), to.filename(), node}});
  }
  void remove(const Path& path) override {
    step("remove", path, false);
    const auto node = find(path);
    if (!node) return;
    if (node->folder)
      for (const std::string& name : list(path)) remove(path / name);
    change({{at("remove", path.parent_path()), path.filename(), nullptr}});
  }
  std::shared_ptr<void> lock(const Path&, bool) override { return std::make_shared<int>(); }
  void keep_private(const Path&) override {}  // it has no owners

 private:
  static constexpr std::size_t kNever = static_cast<std::size_t>(-1);
  struct Node {
    bool folder = false;
    std::map<std::string, std::shared_ptr<Node>> names, names_on_disk;
    std::string bytes, bytes_on_disk;
  };
  struct Entry {
    std::shared_ptr<Node> in;
    std::string name;
    std::shared_ptr<Node> what;  // null: taken away
  };
  using Change = std::vector<Entry>;  // happens as a whole, as a journal has it

  void step(const char* what, const Path& path, bool needs_room) {
    if (dead_ || count_ == power_fails_at_) {
      dead_ = true;
      throw PowerFailed();
    }
    if (count_++ >= fails_from_ && (needs_room || all_)) throw FileError(what, path, error_);
  }
  std::shared_ptr<Node> find(const Path& path) const {
    std::shared_ptr<Node> node = root_;
    for (const Path& name : path.relative_path()) {
      const auto next = node->names.find(name.string());
      if (next == node->names.end()) return nullptr;
      node = next->second;
    }
    return node;
  }
  std::shared_ptr<Node> at(const char* what, const Path& path) const {
    if (dead_) throw PowerFailed();
    auto node = find(path);
    if (!node) throw FileError(what, path, ENOENT);
    return node;
  }
  void change(Change entries) {
    for (const Entry& entry : entries) {
      if (entry.what)
        entry.in->names[entry.name] = entry.what;
      else
        entry.in->names.erase(entry.name);
    }
    unsynced_.push_back(std::move(entries));
  }
  static void apply(const Change& change) {
    for (const Entry& entry : change) {
      if (entry.what)
        entry.in->names_on_disk[entry.name] = entry.what;
      else
        entry.in->names_on_disk.erase(entry.name);
    }
  }
  // What is seen is what is on disk.
  static void settle(Node& node, std::set<Node*>& seen, Unsynced unsynced, std::mt19937& random) {
    if (!seen.insert(&node).second) return;
    if (node.bytes != node.bytes_on_disk && unsynced != Unsynced::kLost) {
      const bool part = unsynced == Unsynced::kByChance;
      node.bytes_on_disk =
          node.bytes.substr(0, part ? random() % (node.bytes.size() + 1) : std::string::npos);
    }
    node.bytes = node.bytes_on_disk;
    node.names = node.names_on_disk;
    for (const auto& [name, child] : node.names) settle(*child, seen, unsynced, random);
  }

  std::shared_ptr<Node> root_ = [] {
    auto root = std::make_shared<Node>();
    root->folder = true;
    return root;
  }();
  std::vector<Change> unsynced_;
  std::size_t count_ = 0, power_fails_at_ = kNever, fails_from_ = kNever;
  int error_ = 0;
  bool all_ = false, dead_ = false;
};

}  // namespace teletact::service
