// Measurements into a case: drop files, see what was guessed of their columns, correct it, make the case.
export class Mapper {
  constructor(app, opened) {
    this.app = app;
    this.opened = opened;
    this.element = app.h('section', { class: 'drop', 'aria-label': 'New case from measurements' },
      app.h('strong', { text: 'Drop measurements here' }),
      app.h('div', { class: 'soft small', text: 'CSV, Parquet, or a CAN log with its DBC' }));
  }
}
