// Empty source of the tests' precompiled headers.
// SPDX-License-Identifier: Apache-2.0
