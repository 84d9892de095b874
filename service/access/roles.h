// What each role may do. For people the table stands in docs/guide/service.md (Security).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace teletact::service {

enum class Role { kPatient, kOperator, kObserver, kAdministrator };
inline constexpr std::array kRoles{Role::kPatient, Role::kOperator, Role::kObserver, Role::kAdministrator};

// What a call needs of who makes it.
enum class Need {
  kKnown,    // to be known: GetInfo
  kRead,     // GetScene, ListScenes, Observe
  kFeel,     // Touch, without steering
  kSteer,    // Touch that may steer
  kPublish,  // CreateScene, PublishSlice, Estimate
  kFollow,   // WatchFinger
  kDelete,   // DeleteScene
};

bool allows(Role, Need);

// "operator", as the file of access names it.
const char* name_of(Role);
std::optional<Role> role_of(std::string_view name);
// What one does who needs it: "steer a touch of".
const char* words_of(Need);
// Who may: "operator or administrator".
std::string roles_for(Need);

}  // namespace teletact::service
