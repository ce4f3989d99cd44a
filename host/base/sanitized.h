// SPDX-License-Identifier: Apache-2.0
//
// Whether this is built with a sanitizer that knows only the stacks that threads begin with.
#pragma once

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define URGENGO_SANITIZED 1
#elif defined(__has_feature)
#define URGENGO_SANITIZED (__has_feature(address_sanitizer) || __has_feature(thread_sanitizer))
#else
#define URGENGO_SANITIZED 0
#endif
