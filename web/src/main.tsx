import { render } from 'preact';
import './styles/tokens.css';
import './styles/base.css';
import './styles/controls.css';
import './styles/layout.css';
import { enter } from './state/enter';
import { startRouter } from './state/router';
import { takeTokenFromAddress } from './state/session';
import { startTheme } from './state/theme';
import { App } from './app';

takeTokenFromAddress();
startTheme();
startRouter();
void enter();
render(<App />, document.getElementById('app')!);
