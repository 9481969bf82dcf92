"""Audit of existing cameras: what each sees, what it adds, and the smallest subset."""

from rastercov.placement.audits.audit import Audit, audit

__all__ = ["Audit", "audit"]
