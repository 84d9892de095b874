// One list: what may be set has a default within its range, and is set by its name and nothing else. The rest
// is constant.
#include "service/base/limits.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <stdexcept>
#include <string>

namespace teletact::service {
namespace {

std::string why_refused(const std::string& name, double value) {
  Limits limits;
  try {
    set_limit(limits, name, value);
    return "";
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

TEST(Limits, TheListIsWhole) {
  // Every member stands in the list: a value set through it is found there, and the members fill the struct.
  EXPECT_EQ(limit_rows().size() * 8, sizeof(Limits));
  std::set<std::string> names;
  const Limits usual;
  for (const LimitRow& row : limit_rows()) {
    EXPECT_TRUE(names.insert(row.name).second) << row.name << " stands twice";
    EXPECT_NE(std::string(row.unit), "") << row.name;
    if (!row.meaning) continue;
    EXPECT_LE(row.min, row.value(usual)) << row.name;
    EXPECT_LE(row.value(usual), row.max) << row.name;
    EXPECT_NE(std::string(row.meaning), "") << row.name;
  }
}

TEST(Limits, EachIsSetByItsNameAndChangesNothingElse) {
  for (const LimitRow& row : limit_rows())
    for (const double value : {row.min, row.max}) {
      if (!row.meaning) continue;
      Limits limits;
      set_limit(limits, row.name, value);
      for (const LimitRow& other : limit_rows())
        EXPECT_EQ(other.value(limits), &other == &row ? value : other.value({}))
            << row.name << ", " << other.name;
    }
}

TEST(Limits, ThoseThatNobodySetsAreConstants) {
  std::size_t settable = 0;
  for (const LimitRow& row : limit_rows()) {
    const std::string why = why_refused(row.name, row.value({}));
    EXPECT_EQ(why.find("it is a constant") == std::string::npos, row.meaning != nullptr) << row.name;
    settable += row.meaning != nullptr;
  }
  EXPECT_EQ(settable, 20U);
  EXPECT_EQ(why_refused("max_samples", 100), "max_samples: it is a constant, 16384; take the line out");
}

TEST(Limits, WhatIsBeyondItsRangeIsRefusedByName) {
  for (const LimitRow& row : limit_rows())
    for (const double value : {row.min - 1, 2 * row.max + 1, std::nan(""), HUGE_VAL, -HUGE_VAL})
      EXPECT_EQ(why_refused(row.name, value).find(std::string(row.name) + ": "), 0U) << value;
  EXPECT_NE(why_refused("max_scenes", 3.5).find("whole"), std::string::npos);
  EXPECT_EQ(why_refused("max_spoons", 3).find("max_spoons: "), 0U);
  EXPECT_EQ(why_refused("most_scenes", 3), "most_scenes: it is called max_scenes now");
  EXPECT_EQ(why_refused("least_tip_m", 3), "least_tip_m: it is called min_tip_m now");
  EXPECT_EQ(why_refused("most_spoons", 3), "most_spoons: no such limit; GetInfo names them");
}

// Any two that are set fit together.
TEST(Limits, NoMinimumPassesItsMaximum) {
  std::map<std::string, const LimitRow*> rows;
  for (const LimitRow& row : limit_rows()) rows[row.name] = &row;
  std::size_t pairs = 0;
  for (const auto& [name, row] : rows) {
    const auto max = rows.find("max_" + (name.size() > 4 ? name.substr(4) : ""));
    if (name.rfind("min_", 0) != 0 || max == rows.end()) continue;
    const auto bound = [](const LimitRow& of, double set) { return of.meaning ? set : of.value({}); };
    EXPECT_LE(bound(*row, row->max), bound(*max->second, max->second->min)) << name;
    ++pairs;
  }
  EXPECT_GE(pairs, 9U);
}

TEST(Limits, MemoryIsAQuarterOfTheHostAndHalfOfTheDeviceUnlessSet) {
  const Limits usual = resolved({}, 8000, 6000);
  EXPECT_EQ(usual.host_memory_bytes, 2000U);
  EXPECT_EQ(usual.device_memory_bytes, 3000U);
  EXPECT_EQ(usual.client_memory_share, 0.1);
  Limits set;
  set.host_memory_bytes = 77;
  EXPECT_EQ(resolved(set, 8000, 6000).host_memory_bytes, 77U);
  EXPECT_GT(host_memory_bytes(), 1U << 20);
}

TEST(Limits, MemoryOfAContainerOrAJobIsWhatItMayHave) {
  namespace fs = std::filesystem;
  const fs::path groups = fs::temp_directory_path() / ("teletact-cgroup-" + std::to_string(getpid()));
  fs::create_directories(groups / "slurm" / "job_1");
  const auto bytes_in = [&](const char* group) {
    std::ofstream(groups / "own") << "4:devices:/x\n0::" << group << "\n";
    return host_memory_bytes(groups / "own", groups);
  };
  const auto limit = [&](const char* group, const char* bytes) {
    std::ofstream(groups / group / "memory.max") << bytes << "\n";
  };
  const std::uint64_t machine = host_memory_bytes("/nowhere", "/nowhere");
  EXPECT_GT(machine, 1U << 20);
  EXPECT_EQ(bytes_in("/slurm/job_1"), machine) << "nothing says a limit";
  // The process in a group of its own, as a container shows it.
  for (const char* none : {"max", "0", "9223372036854775807"}) {
    limit("", none);
    EXPECT_EQ(bytes_in("/"), machine) << none;
  }
  limit("", "1048576");
  EXPECT_EQ(bytes_in("/"), 1U << 20);
  // A job: the least of those that it is in.
  limit("", "max"), limit("slurm", "4194304"), limit("slurm/job_1", "2097152");
  EXPECT_EQ(bytes_in("/slurm/job_1"), 1U << 21);
  limit("slurm/job_1", "max");
  EXPECT_EQ(bytes_in("/slurm/job_1"), 1U << 22);
  EXPECT_EQ(bytes_in("/other"), machine);
  fs::remove_all(groups);
}

}  // namespace
}  // namespace teletact::service
